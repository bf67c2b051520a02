"""Image quality measured from pictures by the methods of IEC 62220-1-2: MTF, NNPS, DQE.

They look at recorded pictures only and know nothing of how those were made, so that they can check
this package, another simulation or a real system. Pictures must be linear in exposure.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError

OVERSAMPLING = 10  # bins a pixel of the edge spread function
REACH_MM = 5.0  # of the edge spread function on either side
ROWS_BESIDE_AXIS = 7  # of the power spectrum, on either side of each axis, which is left out


def edge_mtf(
    image: NDArray[np.floating], pixel_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Presampling modulation transfer function from a slanted edge.

    Parameters
    ----------
    image : ndarray, [row, column]
        Part of a picture with one straight edge that runs from its first to its last row, a few
        degrees off the columns.
    pixel_mm : float

    Returns
    -------
    frequency_per_mm, mtf : ndarray of float64, (n,)
        From 0 to the Nyquist frequency of the pixels.

    Raises
    ------
    InputError
        If no edge is found, or it is so straight up that its rows do not sample it in turn.

    Notes
    -----
    A line is fitted through the places where the rows cross the mean of both sides. Pixels are
    sorted by their distance from it into bins of a tenth of a pixel, the edge spread function;
    its difference is the line spread function, whose spectrum over that at frequency 0 is the
    MTF, freed of the blur of binning and differencing.

    References
    ----------
    IEC 62220-1-2:2007, clause 6.3; Buhr, Guenther-Kohfahl & Neitzel 2003, Med Phys 30:2323.
    """
    slope, offset = _edge_line(image)
    rows, columns = np.indices(image.shape)
    across = (columns - (slope * rows + offset)) / np.hypot(1.0, slope) * OVERSAMPLING
    reach = min(round(REACH_MM / pixel_mm), _room(slope, offset, image.shape)) * OVERSAMPLING
    bins = np.floor(across).astype(np.int64) + reach
    inside = (bins >= 0) & (bins < 2 * reach)
    count = np.bincount(bins[inside], minlength=2 * reach)
    if np.any(count == 0):
        raise InputError(
            f"edge_mtf: found an edge at {np.degrees(np.arctan(slope)):.2f} degrees to the "
            "columns, which leaves bins of a tenth of a pixel empty; expected about 1.5 to 3"
        )
    spread = np.bincount(bins[inside], image[inside], minlength=2 * reach) / count
    line = np.diff(spread)
    step_mm = pixel_mm / OVERSAMPLING
    frequency = np.fft.rfftfreq(line.size, step_mm).astype(np.float64)
    kept = frequency <= 0.5 / pixel_mm * (1.0 + 1e-9)
    spectrum = np.abs(np.fft.rfft(line))
    mtf: NDArray[np.float64] = spectrum / spectrum[0] / np.sinc(frequency * step_mm) ** 2
    return frequency[kept], mtf[kept]


def _edge_line(image: NDArray[np.floating]) -> tuple[float, float]:
    """Slope (columns a row) and column in row 0 of an edge."""
    width = max(2, image.shape[1] // 8)
    left, right = float(image[:, :width].mean()), float(image[:, -width:].mean())
    noise = float(image[:, :width].std() + image[:, -width:].std())
    if not abs(right - left) > noise:
        raise InputError(
            f"edge_mtf: found {left:g} on the left and {right:g} on the right, expected an edge"
        )
    # Area beyond the edge in each row gives its place to a fraction of a pixel.
    place = ((image - right) / (left - right)).sum(axis=1, dtype=np.float64) - 0.5
    slope, offset = np.polyfit(np.arange(image.shape[0]), place, 1)
    return float(slope), float(offset)


def _room(slope: float, offset: float, shape: tuple[int, ...]) -> int:
    """Whole pixels between the edge and the picture's nearer side."""
    ends = np.array([offset, offset + slope * (shape[0] - 1)])
    return int(min(ends.min(), shape[1] - 1 - ends.max())) - 1


def noise_power(
    images: Iterable[NDArray[np.floating]], pixel_mm: float, side: int = 256
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normalised noise power spectrum of flat fields.

    Parameters
    ----------
    images : iterable of ndarray, [row, column]
        Pictures, or parts of them, of nothing but a uniform field.
    pixel_mm : float
    side : int
        Side of the squares that are transformed, pixels; they overlap by half.

    Returns
    -------
    frequency_per_mm : ndarray of float64, (side / 2 - 1,)
        Above 0, up to below the Nyquist frequency.
    nnps_mm2 : ndarray of float64, (side / 2 - 1,)
        Noise power over the square of the mean, mm2: mean over rows and columns of frequencies
        beside both axes, the axes left out.

    Raises
    ------
    InputError
        If no picture holds a square.

    References
    ----------
    IEC 62220-1-2:2007, clause 6.4: squares of 256 pixels, a second-order trend taken off each,
    seven rows on either side of an axis.
    """
    total, squares = np.zeros((side, side)), 0
    trend = _trend(side)
    for image in images:
        for top in range(0, image.shape[0] - side + 1, side // 2):
            for left in range(0, image.shape[1] - side + 1, side // 2):
                square = image[top : top + side, left : left + side].astype(np.float64)
                flat = square.ravel() - trend @ (trend.T @ square.ravel())
                power = np.abs(np.fft.fft2(flat.reshape(side, side))) ** 2
                total += power / square.mean() ** 2
                squares += 1
    if squares == 0:
        raise InputError(f"noise_power: found no image of {side} x {side} pixels or more")
    total *= pixel_mm**2 / (squares * side**2)
    near = np.r_[1 : ROWS_BESIDE_AXIS + 1, side - ROWS_BESIDE_AXIS : side]
    along: NDArray[np.float64] = 0.5 * (total[near].mean(axis=0) + total[:, near].mean(axis=1))
    frequency = np.fft.fftfreq(side, pixel_mm).astype(np.float64)
    used = slice(1, side // 2)
    return frequency[used], along[used]


def _trend(side: int) -> NDArray[np.float64]:
    """[pixel, 6] orthonormal basis of the second-order surfaces on a square."""
    place = np.linspace(-1.0, 1.0, side)
    x, y = (axis.ravel() for axis in np.meshgrid(place, place))
    basis, _ = np.linalg.qr(np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1))
    return basis


def detective_efficiency(
    mtf: NDArray[np.float64], nnps_mm2: NDArray[np.float64], photons_per_mm2: float
) -> NDArray[np.float64]:
    """Detective quantum efficiency at the frequencies of both measurements.

    Parameters
    ----------
    mtf, nnps_mm2 : ndarray of float64, (n,)
        At the same frequencies.
    photons_per_mm2 : float
        Photons that reach the detector: the square of the signal-to-noise ratio of an ideal
        counter, per area.

    Examples
    --------
    A detector that counts half of 1000 photons per mm2 and does not blur:

    >>> detective_efficiency(np.ones(2), np.full(2, 1 / 500.0), 1000.0).tolist()
    [0.5, 0.5]
    """
    efficiency: NDArray[np.float64] = mtf**2 / (photons_per_mm2 * nnps_mm2)
    return efficiency

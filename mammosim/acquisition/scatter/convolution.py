"""Scattered radiation: kernels that depend on thickness, fitted to measured ratios."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mammosim.acquisition.scatter.scatter_case import Scatter, ScatterCase

# SPR = 1 / (a + b D^-1.5 + c T^-0.5), D and T in cm: Boone, Lindfors, Cooper & Seibert 2000,
# Med Phys 27:2408, "Scatter/primary in mammography: comprehensive results". Monte Carlo for
# semicircular breasts of diameter D = 3-30 cm and thickness T = 2-8 cm, Mo/Mo, air gap 15 mm, no
# grid; about 1 per cent.
BOONE = (-2.354528, 22.396098, 8.850643)

# a1, lambda1 (mm), a2, lambda2 (mm) of the kernel
#   k(r) = a1 exp(-r/lambda1) / (2 pi lambda1^2) + a2 exp(-r/lambda2) / (2 pi lambda2^2)
# for thicknesses of 1, 2, ... 10 cm: least squares of relative errors, so that a uniform semicircle
# has Boone's ratio at its centre of mass for 25 diameters of 3-30 cm; largest misfit 0.7 per cent.
# 1, 9 and 10 cm rest on the formula beyond its data.
KERNELS = np.array(
    [
        [0.1080, 3.3829, 0.0426, 12.6112],
        [0.1595, 4.2437, 0.0885, 14.4803],
        [0.2039, 4.9574, 0.1441, 15.9578],
        [0.2437, 5.5973, 0.2149, 17.2235],
        [0.2774, 6.1749, 0.3081, 18.3394],
        [0.3014, 6.6724, 0.4347, 19.3503],
        [0.3101, 7.0469, 0.6101, 20.3294],
        [0.2986, 7.2357, 0.8547, 21.4217],
        [0.2683, 7.1840, 1.1945, 22.8843],
        [0.2300, 6.9034, 1.6715, 25.1268],
    ]
)
KERNEL_STEP_MM = 10.0
KERNEL_REACH_MM = 120.0  # 5 of the longest decay lengths: 4 per cent of that part is beyond
SUBSAMPLES = 4  # points along a cell's side over which the peaked kernel is averaged


def boone_ratio(diameter_cm: float, thickness_cm: float) -> float:
    """Scatter-to-primary ratio of a semicircular breast without a grid.

    Examples
    --------
    >>> round(boone_ratio(16.0, 4.0), 3)
    0.413
    """
    a, b, c = BOONE
    return float(1.0 / (a + b * diameter_cm**-1.5 + c * thickness_cm**-0.5))


def scatter_by_kernels(case: ScatterCase) -> Scatter:
    """The scatter model `kernels`: needs path lengths only, no voxels."""
    return Scatter(scatter_signal(case.primary, case.thickness_mm, case.cell_mm))


def scatter_signal(
    primary: NDArray[np.float64], thickness_mm: NDArray[np.float64], cell_mm: float
) -> NDArray[np.float64]:
    """Scatter behind a breast, on a coarse grid.

    Parameters
    ----------
    primary : ndarray of float64, [row, column]
        Mean primary signal of each cell, any unit.
    thickness_mm : ndarray of float64, [row, column]
        Mean path through all tissue, mm.
    cell_mm : float
        Side of a cell, mm.

    Returns
    -------
    ndarray of float64, [row, column]
        Scatter signal before the grid, in the unit of `primary`.

    Notes
    -----
    Each cell sends out scatter in proportion to its primary, with the kernel of its own thickness
    (linear between two centimetres; none without tissue). Nothing comes from beyond the image.
    """
    reach = round(KERNEL_REACH_MM / cell_mm)
    shape = [fft.next_fast_len(n + reach, real=True) for n in primary.shape]
    level = np.clip(thickness_mm / KERNEL_STEP_MM, 0.0, len(KERNELS))
    spectrum = 0.0
    for index, parameters in enumerate(KERNELS, start=1):
        share = np.maximum(0.0, 1.0 - np.abs(level - index))
        if share.any():
            kernel = _kernel_cells(parameters, cell_mm, reach, shape)
            spectrum = spectrum + fft.rfft2(primary * share, shape) * fft.rfft2(kernel)
    if isinstance(spectrum, float):
        return np.zeros_like(primary)
    result = fft.irfft2(spectrum, shape)[: primary.shape[0], : primary.shape[1]]
    return np.maximum(result, 0.0)


def _kernel_cells(
    parameters: NDArray[np.float64], cell_mm: float, reach: int, shape: list[int]
) -> NDArray[np.float64]:
    """The kernel averaged over each cell times the cell's area, wrapped around [0, 0]."""
    fine = (np.arange((2 * reach + 1) * SUBSAMPLES) + 0.5) / SUBSAMPLES - reach - 0.5
    radius = cell_mm * np.hypot(fine[:, None], fine[None, :])
    a1, l1, a2, l2 = parameters
    value = a1 * np.exp(-radius / l1) / (2.0 * np.pi * l1**2)
    value += a2 * np.exp(-radius / l2) / (2.0 * np.pi * l2**2)
    side = 2 * reach + 1
    cells = value.reshape(side, SUBSAMPLES, side, SUBSAMPLES).mean(axis=(1, 3)) * cell_mm**2
    wrapped = np.zeros(shape)
    rows, columns = np.arange(-reach, reach + 1) % shape[0], np.arange(-reach, reach + 1) % shape[1]
    np.add.at(wrapped, (rows[:, None], columns[None, :]), cells)
    return wrapped

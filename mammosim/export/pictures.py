"""Pictures without patient data: 16-bit TIFF, label image, preview."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from mammosim.acquisition import Mammogram
from mammosim.export.atomic import whole_file
from mammosim.export.lesion_masks import LesionMask, label_image, lesion_channels
from mammosim.projection import PathLengths
from mammosim.targets import Target

_MM_PER_CM = 10.0
_MM_PER_INCH = 25.4
_LARGEST_TIFF = 4_000_000_000  # offsets of the classic format have 32 bits
_WHITE_16 = 65535
_PREVIEW_PIXELS = 4_000_000  # a preview of more is halved: it should open at once everywhere

GLANDULAR_MATERIALS = ("gland",)
"""Materials whose length is glandular thickness: lobes, lobules and ducts."""


def write_mammogram_tiff(mammogram: Mammogram, path: str | PathLike[str]) -> None:
    """Write the For Processing pixels as TIFF.

    Parameters
    ----------
    mammogram : Mammogram
    path : path

    Notes
    -----
    One page of 16-bit unsigned integers, [row, column] as on the detector, linear in exposure, not
    compressed; the resolution tags hold the detector's pixel pitch, in pixels per cm.
    """
    _write_tiff(path, mammogram.for_processing.astype(np.uint16), mammogram.gantry.pixel_mm)


def write_lesion_tiff(
    masks: Sequence[LesionMask], mammogram: Mammogram, path: str | PathLike[str]
) -> None:
    """Write where lesions are on the picture, as one label image.

    Parameters
    ----------
    masks : sequence of LesionMask
    mammogram : Mammogram
        Gives the size and the pixel pitch.
    path : path

    Notes
    -----
    A pixel's value is the `target_id` of the lesion that its ray meets, 0 without one. Where
    lesions overlap on the picture it is the smaller one's; the DICOM segmentation keeps both.
    """
    image = label_image(masks, (mammogram.gantry.rows, mammogram.gantry.columns))
    _write_tiff(path, image, mammogram.gantry.pixel_mm, compression="zlib")


def write_stack_tiff(
    pages: Sequence[NDArray[np.generic]] | NDArray[np.generic],
    pixel_mm: float,
    path: str | PathLike[str],
    compression: str | None = None,
) -> None:
    """Write pictures of one size as the pages of one file, in their order.

    Parameters
    ----------
    pages : sequence of ndarray, each [row, column]
        Of one shape and type.
    pixel_mm : float
        Pixel pitch, mm; the resolution tags hold it in pixels per cm.
    path : path
    compression : str, optional
        As tifffile names it, for instance `zlib`; default: none.

    Notes
    -----
    Files above the limit of TIFF's 32-bit offsets become BigTIFF. Nothing but pixels, pitch and the
    name of the software is stored, so that the same pictures give the same bytes.
    """
    per_cm = _MM_PER_CM / pixel_mm
    size = len(pages) * pages[0].nbytes
    with whole_file(path) as part, tifffile.TiffWriter(part, bigtiff=size > _LARGEST_TIFF) as file:
        for page in pages:
            file.write(
                page,
                photometric="minisblack",
                compression=compression,
                resolution=(per_cm, per_cm),
                resolutionunit="CENTIMETER",
                software="mammosim",
                metadata=None,
                contiguous=False,
            )


def write_glandular_tiff(paths: PathLengths, path: str | PathLike[str]) -> None:
    """Write the thickness of glandular tissue along each ray.

    Parameters
    ----------
    paths : PathLengths
    path : path

    Notes
    -----
    32-bit floats, mm, [row, column]: the sum of the path lengths in all materials that count as
    gland, along the oblique ray from the focal spot, not along the direction of compression.
    """
    glandular = [material in GLANDULAR_MATERIALS for material in paths.materials]
    thickness = paths.length_mm[np.array(glandular, dtype=bool)].sum(axis=0, dtype=np.float64)
    _write_tiff(path, thickness.astype(np.float32), paths.pixel_mm)


def write_density_tiff(paths: PathLengths, path: str | PathLike[str]) -> None:
    """Write the volumetric density along each ray, per cent, 32-bit floats.

    Parameters
    ----------
    paths : PathLengths
    path : str or path
        TIFF of [row, column], as the mammogram.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    It is the length of glandular tissue over that of all tissue but muscle, skin included; NaN
    where there is none. Without compression's change of density, as a phantom's volumes are
    counted.
    """
    gland = np.zeros(paths.length_mm.shape[1:])
    breast = np.zeros_like(gland)
    for material, length in zip(paths.materials, paths.length_mm, strict=True):
        if material in GLANDULAR_MATERIALS:
            gland += length
        if material != "muscle":
            breast += length
    density = np.divide(100.0 * gland, breast, out=np.full_like(gland, np.nan), where=breast > 0.0)
    _write_tiff(path, density.astype(np.float32), paths.pixel_mm, compression="zlib")


def write_lesion_lengths_tiff(
    paths: PathLengths, targets: Sequence[Target], path: str | PathLike[str]
) -> None:
    """Write the path length in each lesion, mm, 32-bit floats, one page per lesion by rising id.

    Parameters
    ----------
    paths : PathLengths
    targets : sequence of Target
        Lesions of this view.
    path : str or path
        TIFF; pages are [row, column], as the mammogram.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    A page's description is ``target_id N: name`` of `lesions.csv`.
    """
    found = lesion_channels(paths, targets)
    per_cm = _MM_PER_CM / paths.pixel_mm
    with whole_file(path) as part, tifffile.TiffWriter(part) as file:
        for target, channel in found:
            file.write(
                paths.length_mm[channel],
                photometric="minisblack",
                compression="zlib",
                resolution=(per_cm, per_cm),
                resolutionunit="CENTIMETER",
                software="mammosim",
                description=f"target_id {target.target_id}: {target.name}".encode(),
                metadata=None,
                contiguous=False,
            )


def _write_tiff(
    path: str | PathLike[str],
    pixels: NDArray[np.generic],
    pixel_mm: float,
    compression: str | None = None,
) -> None:
    per_cm = _MM_PER_CM / pixel_mm
    with whole_file(path) as part:
        tifffile.imwrite(
            part,
            pixels,
            photometric="minisblack",
            compression=compression,
            resolution=(per_cm, per_cm),
            resolutionunit="CENTIMETER",
            software="mammosim",
            metadata=None,
        )


def write_preview(mammogram: Mammogram, path: str | PathLike[str]) -> None:
    """Write the For Presentation image through its window as an 8-bit PNG.

    Parameters
    ----------
    mammogram : Mammogram
    path : str or path

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    Pictures of 4 million pixels and more are halved by the mean of 2 x 2 pixels; the pixel
    spacing is in the file (pHYs) either way.
    """
    pixel_mm = mammogram.gantry.pixel_mm
    pixels: NDArray[Any] = mammogram.for_presentation
    if pixels.size >= _PREVIEW_PIXELS:
        pixels, pixel_mm = _halved(pixels), pixel_mm * 2.0
    grey = through_window(pixels, mammogram.window_center, mammogram.window_width)
    per_inch = _MM_PER_INCH / pixel_mm
    with whole_file(path) as part:
        Image.fromarray(grey).save(part, dpi=(per_inch, per_inch), optimize=False)


def write_full_picture(mammogram: Mammogram, path: str | PathLike[str]) -> None:
    """Write the For Presentation image through its window as 16-bit PNG, every pixel of it.

    Parameters
    ----------
    mammogram : Mammogram
    path : path

    Notes
    -----
    Pixel values p become 65535 (p - (c - 0.5 - (w - 1)/2)) / (w - 1), clipped to 0 and 65535, with
    window centre c and width w: DICOM's linear window (PS3.3 C.11.2.1.2.1).
    """
    low = mammogram.window_center - 0.5 - 0.5 * (mammogram.window_width - 1.0)
    levels = np.arange(int(mammogram.for_presentation.max(initial=0)) + 1, dtype=np.float64)
    fraction = np.clip((levels - low) / (mammogram.window_width - 1.0), 0.0, 1.0)
    grey = np.rint(_WHITE_16 * fraction).astype(np.uint16)[mammogram.for_presentation]
    per_inch = _MM_PER_INCH / mammogram.gantry.pixel_mm
    with whole_file(path) as part:
        # Grain hardly packs: the least effort gives nearly the smallest file.
        Image.fromarray(grey).save(part, format="PNG", dpi=(per_inch, per_inch), compress_level=1)


def _halved(pixels: NDArray[np.generic]) -> NDArray[np.float64]:
    """Mean of 2 x 2 pixels; an odd last row or column is left out."""
    rows, columns = (size // 2 for size in pixels.shape)
    blocks = pixels[: rows * 2, : columns * 2].reshape(rows, 2, columns, 2)
    return blocks.mean(axis=(1, 3))


def through_window(pixels: NDArray[np.generic], center: float, width: float) -> NDArray[np.uint8]:
    """Grey levels 0-255 of stored pixels through a linear window (PS3.3 C.11.2.1.2.1).

    Parameters
    ----------
    pixels : ndarray, any shape
    center, width : float
        Window Center and Window Width; the width is above 1.

    Examples
    --------
    >>> through_window(np.array([0, 100, 200]), center=100.5, width=201).tolist()
    [0, 128, 255]
    """
    fraction = (pixels.astype(np.float64) - (center - 0.5)) / (width - 1.0) + 0.5
    return np.rint(255.0 * np.clip(fraction, 0.0, 1.0)).astype(np.uint8)

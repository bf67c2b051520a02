"""Picture and mask of a view as a pair of PNG files, as learning from pictures needs them."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
import pydicom
import tifffile
from PIL import Image

from mammosim.errors import InputError
from mammosim.export.atomic import whole_file


def write_learning_pair(
    view: str | PathLike[str],
    picture: Literal["presentation", "processing"],
    image_file: str | PathLike[str],
    mask_file: str | PathLike[str],
) -> None:
    """Write a view's picture and lesion mask as PNG, pixel by pixel as they are in the run.

    Parameters
    ----------
    view : path
        A view's folder of a finished run.
    picture : {"presentation", "processing"}
        For reading (from its DICOM object), or linear in exposure (from the TIFF file).
    image_file, mask_file : path
        The picture with 16 bits, and the label image with 8: 0, or the `target_id` of a lesion.

    Raises
    ------
    InputError
        If the run's files are missing, or there are more than 255 lesions.
    """
    folder = Path(view)
    try:
        if picture == "presentation":
            pixels = pydicom.dcmread(folder / "for_presentation.dcm").pixel_array
        else:
            pixels = tifffile.imread(folder / "mammogram.tif")
        mask = tifffile.imread(folder / "lesion_mask.tif")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be read ({error.strerror})") from None
    if mask.max(initial=0) > 255:
        raise InputError(f"{folder}: found a lesion numbered {mask.max()}, expected at most 255")
    for path, values in (
        (image_file, pixels.astype(np.uint16)),
        (mask_file, mask.astype(np.uint8)),
    ):
        with whole_file(path) as part:
            Image.fromarray(values).save(part, format="PNG")

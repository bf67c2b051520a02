"""Files of a mammogram with a contrast agent: its high-energy exposure and the image of iodine."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence

from mammosim.acquisition import Mammogram
from mammosim.export import dicom_modules as modules
from mammosim.export.dicom import acquired, image_dataset
from mammosim.export.dicom_agent import contrast_agent
from mammosim.export.dicom_object import decimal_string, save_object
from mammosim.export.dicom_series import Intent, series_description
from mammosim.export.identity import StudyIdentity
from mammosim.export.pictures import write_stack_tiff
from mammosim.export.settings import ExportSettings

STEPS_PER_MG_CM2 = 400.0
"""Pixel values for 1 mg/cm2 of iodine in `recombined.dcm`; noise is ten steps and more."""

ZERO = 2000.0
"""Pixel value of no iodine there: 12 bits reach from -5 to 5 mg/cm2."""

WINDOW_MG_CM2 = (-1.0, 2.0)
"""Iodine that is shown black and white; lesions have up to some 2 mg/cm2. Chosen."""


def write_contrast(
    mammogram: Mammogram,
    folder: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write what follows the low-energy exposure; nothing where there is no contrast agent.

    Parameters
    ----------
    mammogram : Mammogram
        The low-energy exposure.
    folder : path
        Gets ``high_energy.dcm`` (For Processing), ``recombined.dcm`` (For Presentation) and
        ``iodine.tif`` (mg/cm2, 32-bit floats), as the settings say.
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    if mammogram.contrast is None:
        return
    folder = Path(folder)
    if settings.dicom:
        for name, dataset in contrast_datasets(mammogram, study, settings).items():
            save_object(dataset, folder / f"{name}.dcm")
    if settings.tiff:
        iodine, pixel_mm = mammogram.contrast.iodine.mg_cm2, mammogram.gantry.pixel_mm
        write_stack_tiff([iodine], pixel_mm, folder / "iodine.tif", compression="zlib")


def contrast_datasets(
    mammogram: Mammogram, study: StudyIdentity, settings: ExportSettings
) -> dict[str, Dataset]:
    """The high-energy exposure and the recombined image as DICOM objects, by file name."""
    if mammogram.contrast is None:
        return {}
    high, view = mammogram.contrast.high_energy, mammogram.gantry.view
    exposure: dict[str, Any] = {
        **modules.processing(),
        **contrast_agent("HIGH_ENERGY", raw=True),
        "SeriesDescription": series_description(view, " high energy"),
        "IrradiationEventUID": study.uid("exposure", view.folder, "high energy"),
    }
    made = {}
    objects: tuple[tuple[str, str, Intent, Mammogram, dict[str, Any], NDArray[np.uint16]], ...] = (
        ("high_energy", "high energy", "processing", high, exposure, high.for_processing),
        ("recombined", "iodine", "presentation", mammogram, _recombined(mammogram, study),
         iodine_pixels(mammogram.contrast.iodine.flattened_mg_cm2)),
    )  # fmt: skip
    for name, series, intent, taken, own, pixels in objects:
        attributes = {**acquired(taken, intent, series, study, settings), **own}
        uid = study.uid("image", view.folder, name)
        made[name] = image_dataset(attributes, pixels, intent, uid)
    return made


def _recombined(mammogram: Mammogram, study: StudyIdentity) -> dict[str, Any]:
    """DX Image of iodine, with references to both exposures."""
    view = mammogram.gantry.view
    sources = [study.uid("image", view.folder, name) for name in ("processing", "high_energy")]
    low, high = (ZERO + STEPS_PER_MG_CM2 * mg_cm2 for mg_cm2 in WINDOW_MG_CM2)
    return {
        **contrast_agent("", raw=False),
        "ImageType": ["DERIVED", "PRIMARY", "", "SUBTRACTION"],
        "SeriesDescription": series_description(view, " iodine"),
        "AcquisitionDeviceProcessingDescription": "Weighted logarithmic subtraction",
        "SourceImageSequence": Sequence([modules.source_image(uid) for uid in sources]),
        "PhotometricInterpretation": "MONOCHROME2",
        "PixelIntensityRelationship": "LOG",
        "PixelIntensityRelationshipSign": -1,
        "PresentationLUTShape": "IDENTITY",
        "WindowCenter": decimal_string(0.5 * (low + high)),
        "WindowWidth": decimal_string(high - low),
        "WindowCenterWidthExplanation": "Iodine",
    }


def iodine_pixels(mg_cm2: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Pixel values, 12 bits, of iodine in mg/cm2."""
    largest = 2 ** modules.BITS_STORED["presentation"] - 1
    pixels: NDArray[np.uint16] = np.clip(
        np.rint(mg_cm2 * STEPS_PER_MG_CM2 + ZERO), 0, largest
    ).astype(np.uint16)
    return pixels

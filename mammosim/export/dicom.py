"""Digital Mammography X-Ray Image objects, For Processing and For Presentation.

The image says in several places that no patient was imaged.
"""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset

from mammosim.acquisition import Mammogram
from mammosim.export import dicom_modules as modules
from mammosim.export.dicom_agent import contrast_agent
from mammosim.export.dicom_object import save_object, set_attributes, set_identity
from mammosim.export.dicom_series import Intent, identification, image_uid
from mammosim.export.identity import StudyIdentity
from mammosim.export.settings import ExportSettings


def write_dicom(
    mammogram: Mammogram,
    intent: Intent,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
    draw: int = 1,
) -> None:
    """Write one Digital Mammography X-Ray Image object.

    Parameters
    ----------
    mammogram : Mammogram
    intent : {"processing", "presentation"}
        Which of the two pictures.
    path : path
    study : StudyIdentity
    settings : ExportSettings
    draw : int
        Number of the noise's draw, from 1; all are in one series.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    dataset = mammogram_dataset(mammogram, intent, study, settings, draw)
    save_object(dataset, path)


def mammogram_dataset(
    mammogram: Mammogram,
    intent: Intent,
    study: StudyIdentity,
    settings: ExportSettings,
    draw: int = 1,
) -> Dataset:
    """Make one Digital Mammography X-Ray Image object; the parameters are `write_dicom`'s.

    Returns
    -------
    pydicom.Dataset
        With its meta header and pixels, ready to be saved.
    """
    view, raw = mammogram.gantry.view, intent == "processing"
    enhanced = {} if mammogram.contrast is None else contrast_agent("LOW_ENERGY", raw)
    attributes = {
        **acquired(mammogram, intent, intent, study, settings, draw),
        **(modules.processing() if raw else modules.presentation(mammogram, study, draw)),
        **enhanced,
        "InstanceNumber": draw,
    }
    pixels = mammogram.for_processing if raw else mammogram.for_presentation
    return image_dataset(attributes, pixels, intent, image_uid(study, view, intent, draw))


def acquired(
    mammogram: Mammogram,
    intent: Intent,
    series: str,
    study: StudyIdentity,
    settings: ExportSettings,
    draw: int = 1,
) -> dict[str, Any]:
    """Attributes that every image of an exposure has, whatever its pixels show.

    Parameters
    ----------
    mammogram : Mammogram
        The exposure.
    intent : {"processing", "presentation"}
    series : str
        A kind of object, as `identification` takes it.
    study : StudyIdentity
    settings : ExportSettings
    draw : int
        Number of the noise's draw, from 1.
    """
    return {
        **identification(study, settings, series, mammogram.gantry.view),
        **modules.image(study, intent, mammogram, draw),
        **modules.detector(mammogram),
        **modules.positioning(mammogram),
        **modules.technique(mammogram),
    }


def image_dataset(
    attributes: Mapping[str, Any], pixels: NDArray[np.uint16], intent: Intent, uid: str
) -> Dataset:
    """Make one image object.

    Parameters
    ----------
    attributes : mapping
        By keyword, all but those of the pixels; those that are None are left out.
    pixels : ndarray of uint16, [row, column]
    intent : {"processing", "presentation"}
    uid : str
        SOP Instance UID.

    Returns
    -------
    pydicom.Dataset
        With its meta header, ready to be saved.
    """
    dataset = Dataset()
    set_attributes(dataset, attributes)
    set_attributes(dataset, modules.pixel_data(pixels, modules.BITS_STORED[intent]))
    set_identity(dataset, modules.SOP_CLASS[intent], uid)
    return dataset

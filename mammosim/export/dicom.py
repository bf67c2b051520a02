"""Digital Mammography X-Ray Image objects, For Processing and For Presentation.

The image says in several places that no patient was imaged.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from typing import Any

from pydicom import Dataset

from mammosim.acquisition import Mammogram
from mammosim.export import dicom_modules as modules
from mammosim.export.dicom_agent import contrast_agent
from mammosim.export.dicom_modules import Intent
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
    modules.save_object(dataset, path)


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
    filled = (
        modules.identification(study, settings, intent, view),
        modules.image(study, intent, mammogram, draw),
        modules.detector(mammogram),
        modules.positioning(mammogram),
        modules.technique(mammogram),
        modules.processing() if raw else modules.presentation(mammogram, study, draw),
        modules.pixel_data(
            mammogram.for_processing if raw else mammogram.for_presentation,
            modules.BITS_STORED[intent],
        ),
        enhanced,
    )
    dataset = image_dataset(filled, intent, modules.image_uid(study, view, intent, draw))
    dataset.InstanceNumber = draw
    return dataset


def image_dataset(filled: Iterable[Mapping[str, Any]], intent: Intent, uid: str) -> Dataset:
    """One image object of attributes by module, later ones in place of earlier ones.

    Parameters
    ----------
    filled : iterable of mapping
    intent : {"processing", "presentation"}
    uid : str
        SOP Instance UID.

    Returns
    -------
    pydicom.Dataset
        With its meta header, ready to be saved.
    """
    dataset = Dataset()
    for module in filled:
        modules.set_attributes(dataset, module)
    modules.set_identity(dataset, modules.SOP_CLASS[intent], uid)
    return dataset

"""What objects that refer to a mammogram have in common: their place in the study, and dates."""

from __future__ import annotations

from typing import Any

from pydicom import Dataset

from mammosim.export.dicom_object import set_attributes
from mammosim.export.dicom_series import identification, series_description, series_of
from mammosim.export.identity import IMPLEMENTATION_UID, StudyIdentity
from mammosim.export.settings import ExportSettings
from mammosim.geometry import View

_OF_IMAGES = ("AcquisitionDate", "AcquisitionTime", "PatientComments")


def place_in_study(study: StudyIdentity, kind: str, view: View) -> dict[str, Any]:
    """Arguments by which highdicom places an object of a kind and view in the study."""
    series_uid, series_number = series_of(study, kind, view)
    return {
        "series_instance_uid": series_uid,
        "series_number": series_number,
        "sop_instance_uid": study.uid("image", view.folder, kind),
        "instance_number": 1,
        "manufacturer": "mammosim",
    }


def settle(
    dataset: Dataset,
    study: StudyIdentity,
    settings: ExportSettings,
    kind: str,
    view: View,
    suffix: str,
    *,
    is_image: bool = False,
) -> None:
    """Fill in who and when, in place of what highdicom takes from the clock or leaves out.

    Parameters
    ----------
    dataset : pydicom.Dataset
        Changed in place.
    study : StudyIdentity
    settings : ExportSettings
    kind : str
        Of the series, as `identification` takes it.
    view : View
    suffix : str
        End of the Series Description, after side and view.
    is_image : bool
        Whether the object has the attributes of an acquired image.
    """
    named = identification(study, settings, kind, view)
    left_out = () if is_image else _OF_IMAGES
    set_attributes(dataset, {key: value for key, value in named.items() if key not in left_out})
    dataset.SeriesDescription = series_description(view, suffix)
    dataset.file_meta.ImplementationClassUID = IMPLEMENTATION_UID
    dataset.file_meta.ImplementationVersionName = "MAMMOSIM"
    for equipment in dataset.get("ContributingEquipmentSequence", ()):
        if "ContributionDateTime" in equipment or not is_image:
            equipment.ContributionDateTime = f"{settings.date}000000"

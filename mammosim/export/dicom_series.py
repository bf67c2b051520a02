"""Where an object stands in the study: patient, study, series and identifiers (PS3.3 A.26)."""

from __future__ import annotations

from typing import Any, Literal

from mammosim._version import VERSION
from mammosim.export.dicom_object import long_string
from mammosim.export.identity import StudyIdentity
from mammosim.export.settings import ExportSettings
from mammosim.geometry import View

Intent = Literal["processing", "presentation"]

# Series Number of the first series of each kind of object.
_FIRST_SERIES = {
    "presentation": 1, "iodine": 61, "processing": 101, "high energy": 161, "state": 201,
    "segmentation": 301, "measurements": 401, "slices": 11, "synthetic": 51,
    "projections": 501, "raw projections": 511, "slice segmentation": 521,
}  # fmt: skip

# Order in which a reader looks at a study: right before left, CC before MLO.
_READING_ORDER = ("RCC", "LCC", "RMLO", "LMLO", "RML", "LML")

# Views under a name of their own (spot, magnification, repeats) come after the usual ones.
_TITLED = 20

_EVENTS = ("Study", "Series", "Acquisition", "Content", "InstanceCreation")


def series_of(study: StudyIdentity, kind: str, view: View) -> tuple[str, int]:
    """Series Instance UID and Series Number of one kind of object of one view.

    One series a view and kind, since viewers hang series, not images: all that is for
    presentation first, in the order in which a reader looks at a study.
    """
    number = _FIRST_SERIES[kind] + _READING_ORDER.index(f"{view.laterality}{view.name}")
    if view.title:
        number += _TITLED
    return study.uid("series", kind, view.folder), number


def series_description(view: View, suffix: str = "") -> str:
    """Series Description, which begins with side and view, as `R MLO`.

    Hanging protocols look for these words (OHIF's mammography protocol gives them more weight than
    the coded view). A view's own name in the run stands behind them.
    """
    title = f" {view.title}" if view.title else ""
    return f"{view.laterality} {view.name}{title}{suffix}"


def identification(
    study: StudyIdentity, settings: ExportSettings, series: str, view: View
) -> dict[str, Any]:
    """Patient, study, series and equipment of one object of a run.

    Parameters
    ----------
    study : StudyIdentity
    settings : ExportSettings
    series : str
        A kind of object, as `presentation`, `iodine` or `segmentation`: a key of `_FIRST_SERIES`.
    view : View
    """
    series_uid, series_number = series_of(study, series, view)
    age = study.age_years(settings.date)
    return {
        "SpecificCharacterSet": "ISO_IR 192",
        "PatientName": study.patient_name,
        "PatientID": study.patient_id,
        "PatientBirthDate": study.patient.birth_date or "",
        "PatientSex": study.patient.sex or "F",
        "PatientAge": None if age is None else f"{age:03d}Y",
        "PatientComments": "Simulated; not a patient.",
        "StudyInstanceUID": study.study_uid,
        "StudyID": "1",
        "StudyDescription": long_string(study.study_description),
        "AccessionNumber": study.patient.accession or "",
        "ReferringPhysicianName": "",
        **{f"{event}Date": settings.date for event in _EVENTS},
        **{f"{event}Time": "000000" for event in _EVENTS},
        "SeriesInstanceUID": series_uid,
        "SeriesNumber": series_number,
        "InstanceNumber": 1,
        "Manufacturer": "mammosim",
        "ManufacturerModelName": "mammosim",
        "DeviceSerialNumber": "simulated",
        "SoftwareVersions": VERSION,
        "StationName": "MAMMOSIM",
    }


def image_uid(study: StudyIdentity, view: View, intent: Intent, draw: int = 1) -> str:
    """SOP Instance UID of one picture of a view."""
    return study.uid("image", view.folder, intent, *_further(draw))


def exposure_uid(study: StudyIdentity, view: View, draw: int = 1) -> str:
    """Irradiation Event UID of one exposure of a view."""
    return study.uid("exposure", view.folder, *_further(draw))


def _further(draw: int) -> tuple[str, ...]:
    """What tells a further draw of the noise from the first."""
    return () if draw == 1 else (f"{draw:03d}",)

"""The `patient` section of a configuration: who the DICOM objects are about."""

from __future__ import annotations

from datetime import date, datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator

from mammosim.config import Name, Settings

MAX_AGE_YEARS = 130
"""Of a patient; nobody is known to have been older than 122."""


def _one_value(text: str) -> str:
    if "\\" in text:
        raise ValueError("contains a backslash, which separates values in DICOM")
    return text


DicomText = Annotated[Name, AfterValidator(_one_value)]
"""One value of a DICOM attribute: up to 64 characters, no backslash."""


class PatientSettings(Settings):
    """The patient in the DICOM objects; nobody real is imaged."""

    id: DicomText | None = None
    """Patient ID; default: `SIMULATED-` and the run's hash."""

    name: DicomText | None = None
    """Patient's Name, such as `Doe^Jane`; default: `Simulated^` and the run's hash."""

    birth_date: str | None = None
    """Patient's Birth Date, as YYYYMMDD; default: empty."""

    age_years: int | None = Field(default=None, ge=0, le=MAX_AGE_YEARS)
    """Patient's Age on `export.date`, years; default: from the birth date, if that is given."""

    sex: Literal["F", "M", "O"] | None = None
    """Patient's Sex; default: F."""

    study_description: DicomText | None = None
    """Study Description; default: the name of the run."""

    accession: Annotated[DicomText, Field(max_length=16)] | None = None
    """Accession Number, up to 16 characters; default: empty."""

    study_uid_from: Name | None = None
    """Text from which Patient ID, name and Study Instance UID are derived instead of the run's
    hash, so that several runs form one study of one patient."""

    @field_validator("birth_date", mode="before")
    @classmethod
    def _date_of_calendar(cls, value: Any) -> Any:
        # YAML reads an unquoted 19700102 as a number and 1970-01-02 as a date.
        if value is None:
            return None
        text = str(value).replace("-", "")
        if calendar_date(text) is None:
            raise ValueError("expected a date as YYYYMMDD")
        return text


def calendar_date(text: str) -> date | None:
    """The day that eight digits name; None if there is no such day.

    Examples
    --------
    >>> calendar_date("20240229"), calendar_date("20230229")
    (datetime.date(2024, 2, 29), None)
    """
    if len(text) != 8 or not (text.isascii() and text.isdigit()):
        return None
    try:
        return datetime.strptime(text, "%Y%m%d").date()
    except ValueError:
        return None


def age_on(birth_date: str, day: str) -> int:
    """Whole years from one day to another, both as YYYYMMDD.

    Examples
    --------
    >>> age_on("19700102", "20000101"), age_on("19700101", "20000101")
    (29, 30)
    """
    return int(day[:4]) - int(birth_date[:4]) - (day[4:] < birth_date[4:])


def age_problems(patient: PatientSettings, day: str) -> list[str]:
    """What contradicts itself in birth date and age, one line each.

    Parameters
    ----------
    patient : PatientSettings
    day : str
        When the study is made, as YYYYMMDD.
    """
    if patient.birth_date is None:
        return []
    age = age_on(patient.birth_date, day)
    if not 0 <= age <= MAX_AGE_YEARS:
        return [
            f"patient.birth_date: found {patient.birth_date}, expected a date 0 to "
            f"{MAX_AGE_YEARS} years before export.date ({day})"
        ]
    if patient.age_years is not None and patient.age_years != age:
        return [
            f"patient.age_years: found {patient.age_years}, but patient.birth_date "
            f"{patient.birth_date} gives {age} on export.date ({day})"
        ]
    return []

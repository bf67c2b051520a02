"""The `cohort` section: how many patients, where their values come from, what is made of them."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mammosim.config import Settings

MAX_PATIENTS = 1_000_000
"""Patients have six digits."""


class SplitSettings(Settings):
    """Fractions of the patients for training, validation and testing."""

    train: float = Field(default=0.7, ge=0, le=1)
    """Fraction of the patients for training."""

    validation: float = Field(default=0.15, ge=0, le=1)
    """Fraction of the patients for validation."""

    test: float = Field(default=0.15, ge=0, le=1)
    """Fraction of the patients for testing."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        total = self.train + self.validation + self.test
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"train, validation and test add up to {total:g}, expected 1")
        return self


class DatasetSettings(Settings):
    """A data set for machine learning, beside the patients' folders."""

    pictures: Literal["presentation", "processing"] = "presentation"
    """Which images of each view: For Presentation, or For Processing (linear in exposure)."""

    split: SplitSettings = SplitSettings()
    """Fractions of the split; all views of a patient are in the same part."""


class CohortSettings(Settings):
    """The patients of a cohort."""

    patients: int | None = Field(default=None, ge=1, le=MAX_PATIENTS)
    """Number of patients; default: the number of lines of `patients_file`."""

    patients_file: str | None = None
    """CSV file with a header and one line per patient, for values of `{column: NAME}`; relative to
    the cohort file."""

    memory_gb: float | None = Field(default=None, ge=0.01, le=1e6)
    """Memory that all local workers may use together, GB; default: what is free."""

    attempts: int = Field(default=3, ge=1, le=100)
    """Number of times a patient is started whose worker dies, before it counts as failed; Dask
    itself repeats a patient three times before that counts as one. A patient also fails after four
    times as many starts without finishing a stage, as when workers end too soon."""

    keep_stages: bool = True
    """Keep each patient's compression, so that another acquisition need not compress again."""

    dataset: DatasetSettings | None = None
    """Write a data set for machine learning: images, masks and a manifest."""

    @model_validator(mode="after")
    def _a_number_of_patients(self) -> Self:
        if self.patients is None and self.patients_file is None:
            raise ValueError("patients or patients_file must be given")
        return self

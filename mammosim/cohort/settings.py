"""The `cohort` section: how many patients, where their values come from, what is made of them."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mammosim.config import Settings

MOST_PATIENTS = 1_000_000
"""Patients have six digits."""


class SplitSettings(Settings):
    """Parts of the patients that are for training, for choosing, and for testing."""

    train: float = Field(default=0.7, ge=0, le=1)
    """Part of the patients for training."""

    validation: float = Field(default=0.15, ge=0, le=1)
    """Part of the patients for choosing a model."""

    test: float = Field(default=0.15, ge=0, le=1)
    """Part of the patients that nothing is fitted to."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        total = self.train + self.validation + self.test
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"train, validation and test are {total:g} together, expected 1")
        return self


class DatasetSettings(Settings):
    """A data set for machine learning, beside the patients' folders."""

    pictures: Literal["presentation", "processing"] = "presentation"
    """Which of a view's pictures: for reading, or linear in exposure."""

    split: SplitSettings = SplitSettings()
    """Parts that the patients are split into; all views of a patient are in one part."""


class CohortSettings(Settings):
    """The patients of a cohort."""

    patients: int | None = Field(default=None, ge=1, le=MOST_PATIENTS)
    """Number of patients; left out: the lines of `patients_file`."""

    patients_file: str | None = None
    """CSV file with a line a patient and a header, for values of `{column: NAME}`; relative to
    the cohort's file."""

    memory_gb: float | None = Field(default=None, ge=0.01, le=1e6)
    """Memory that all local workers may use together, GB; left out: what is free."""

    attempts: int = Field(default=3, ge=1, le=100)
    """How often a patient is begun whose worker dies, before it counts as failed. Dask itself
    repeats a patient three times before it counts once. One that is begun four times as often
    without finishing a stage, as where workers end too soon, has failed too."""

    keep_stages: bool = True
    """Keep each patient's compression, so that another acquisition does not compress again."""

    dataset: DatasetSettings | None = None
    """Makes a data set for machine learning: pictures, masks and a manifest."""

    @model_validator(mode="after")
    def _a_number_of_patients(self) -> Self:
        if self.patients is None and self.patients_file is None:
            raise ValueError("patients or patients_file must be given")
        return self

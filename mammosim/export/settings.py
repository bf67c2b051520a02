"""The `export` section of a configuration."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import field_validator, model_validator

from mammosim.config import Settings
from mammosim.export.patient_settings import calendar_date


class ExportSettings(Settings):
    """Which files a run writes."""

    dicom: bool = True
    """Write the mammogram and the lesion mask as DICOM objects."""

    tiff: bool = True
    """Write the 16-bit mammogram and the lesion label image as TIFF."""

    png: bool = True
    """Write an 8-bit preview, and the For Presentation image as a 16-bit PNG."""

    volumes: bool = True
    """Write the compressed labels and the displacement field as NIfTI volumes."""

    compressed_formats: tuple[Literal["nrrd", "mha", "victre"], ...] = ()
    """Further formats of the compressed labels: NRRD, MHA, and VICTRE's for MC-GPU with plates."""

    viewers: bool = False
    """Write files for viewers beside the volumes: for 3D Slicer the labels as a segmentation and
    the targets as markups, with names and colours; for ITK-SNAP label descriptions. Needs
    `export.volumes`."""

    matlab: bool = False
    """Write the compressed lattice, its tissues, measures and convergence as one MATLAB file."""

    path_lengths: bool = False
    """Write the path length of every tissue at every pixel, in mm, as one NumPy archive."""

    glandular_thickness: bool = False
    """Write the thickness of glandular tissue at every pixel, in mm, as 32-bit TIFF."""

    volumetric_density: bool = False
    """Write the fraction of glandular tissue at every pixel, in per cent, as 32-bit TIFF."""

    lesion_lengths: bool = False
    """Write the path length in each lesion at every pixel, in mm, as 32-bit TIFF with one page per
    lesion."""

    dose_map: bool = False
    """Write the absorbed dose of every voxel of the breast's coarse copy, in mGy, as a NIfTI volume
    (scatter model monte-carlo)."""

    date: str = "20000101"
    """Date in the DICOM objects, as YYYYMMDD; fixed, so that reruns are identical."""

    @field_validator("date", mode="before")
    @classmethod
    def _date_of_calendar(cls, value: Any) -> Any:
        # YAML reads an unquoted 20000101 as a number and 2000-01-01 as a date.
        text = str(value).replace("-", "")
        if calendar_date(text) is None:
            raise ValueError("expected a date as YYYYMMDD")
        return text

    @model_validator(mode="after")
    def _viewers_show_volumes(self) -> Self:
        if self.viewers and not self.volumes:
            raise ValueError("viewers: found true without volumes, expected `volumes: true` too")
        return self

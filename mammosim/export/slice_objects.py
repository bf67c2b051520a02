"""Breast Tomosynthesis Image objects: the slices reconstructed from a series of projections."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import BreastTomosynthesisImageStorage

from mammosim._version import VERSION
from mammosim._wording import counted
from mammosim.acquisition import Tomosynthesis
from mammosim.export.dicom_modules import pixel_format
from mammosim.export.dicom_object import set_attributes, set_identity
from mammosim.export.enhanced_modules import (
    SECONDS_PER_PROJECTION,
    frame_anatomy,
    frame_content,
    item_of,
    sequence_of,
    series_and_equipment,
    values_as_stored,
)
from mammosim.export.identity import StudyIdentity
from mammosim.export.settings import ExportSettings
from mammosim.export.volumes import slices_in_patient
from mammosim.reconstruction import Reconstruction

BITS = 12
"""Bits of a pixel."""

LARGEST = (1 << BITS) - 1
"""Largest value of a pixel."""

IMAGE_TYPE = ["DERIVED", "PRIMARY", "TOMOSYNTHESIS", "NONE"]

_METHODS = {
    "fdk": ("FILTER_BACK_PROJ", "Feldkamp, Davis and Kress"),
    "sart": ("ITERATIVE", "SART"),
}


def slice_dataset(
    series: Tomosynthesis, volume: Reconstruction, study: StudyIdentity, settings: ExportSettings
) -> Dataset:
    """Make one Breast Tomosynthesis Image object of all slices.

    Parameters
    ----------
    series : Tomosynthesis
        What they were reconstructed from.
    volume : Reconstruction
    study : StudyIdentity
    settings : ExportSettings
    """
    view, (count, rows, columns) = volume.gantry.view, volume.grid.shape
    low, high = volume.shown_range
    dataset = Dataset()
    for attributes in (
        series_and_equipment(study, settings, "slices", view, " slices"),
        {
            "ImageType": IMAGE_TYPE,
            "PixelPresentation": "MONOCHROME",
            "VolumetricProperties": "VOLUME",
            "VolumeBasedCalculationTechnique": "NONE",
            "PhotometricInterpretation": "MONOCHROME2",
            "PresentationLUTShape": "IDENTITY",
            "ImageComments": (
                f"Simulated image. Attenuation coefficient in 1/mm: {low:.6g} + "
                f"{(high - low) / LARGEST:.6g} * pixel value"
            ),
            **pixel_format(rows, columns, BITS),
            "NumberOfFrames": str(count),
            "XRay3DReconstructionSequence": _method(volume),
            "SharedFunctionalGroupsSequence": Sequence([_shared(volume)]),
            "PerFrameFunctionalGroupsSequence": Sequence(_frames(series, volume, settings)),
        },
    ):
        set_attributes(dataset, attributes)
    dataset.PixelData = pixels_of(volume, low, high).astype("<u2", copy=False).tobytes()
    uid = study.uid("image", view.folder, "slices")
    set_identity(dataset, BreastTomosynthesisImageStorage, uid)
    return dataset


def pixels_of(volume: Reconstruction, low: float, high: float) -> NDArray[np.uint16]:
    """Pixel values of all slices, [slice, row, column], from `low` to `high` in 1/mm."""
    pixels = np.empty(volume.slices.shape, np.uint16)
    for picture, plane in zip(pixels, volume.slices, strict=True):
        scaled = (plane - np.float32(low)) * np.float32(LARGEST / (high - low))
        picture[:] = np.clip(np.rint(scaled), 0, LARGEST)
    return pixels


def _method(volume: Reconstruction) -> Sequence:
    kind, name = _METHODS[volume.settings.method]
    description = name
    if volume.settings.method == "sart":
        description += f", {counted(volume.settings.iterations, 'iteration')}"
    return sequence_of(
        ReconstructionDescription=description,
        ApplicationName="mammosim with RTK",
        ApplicationVersion=VERSION,
        ApplicationManufacturer="mammosim",
        AlgorithmType=kind,
        AlgorithmDescription=name,
        AcquisitionIndex=1,
    )


def _shared(volume: Reconstruction) -> Dataset:
    """Functional groups that are the same for all slices."""
    _, steps_mm = slices_in_patient(volume)
    pixel_mm, slice_mm = f"{volume.grid.pixel_mm:.6g}", f"{volume.grid.slice_mm:.6g}"
    along = steps_mm / np.linalg.norm(steps_mm, axis=0)
    return item_of(
        {
            "PixelMeasuresSequence": sequence_of(
                PixelSpacing=[pixel_mm, pixel_mm],
                SliceThickness=slice_mm,
                SpacingBetweenSlices=slice_mm,
            ),
            "PlaneOrientationSequence": sequence_of(
                ImageOrientationPatient=[_decimal(value) for value in along[:, :2].T.ravel()]
            ),
            "FrameAnatomySequence": frame_anatomy(volume.gantry.view),
            **values_as_stored(BITS),
        }
    )


def _frames(
    series: Tomosynthesis, volume: Reconstruction, settings: ExportSettings
) -> list[Dataset]:
    """Functional groups of each slice."""
    first_mm, steps_mm = slices_in_patient(volume)
    duration_s = SECONDS_PER_PROJECTION * len(series.gantries)
    return [
        item_of(
            {
                "FrameContentSequence": frame_content(settings, 1, number + 1, duration_s),
                "XRay3DFrameTypeSequence": sequence_of(
                    FrameType=IMAGE_TYPE,
                    PixelPresentation="MONOCHROME",
                    VolumetricProperties="VOLUME",
                    VolumeBasedCalculationTechnique="NONE",
                    ReconstructionIndex=1,
                ),
                "PlanePositionSequence": sequence_of(
                    ImagePositionPatient=[
                        _decimal(value) for value in first_mm + number * steps_mm[:, 2]
                    ]
                ),
            }
        )
        for number in range(volume.grid.shape[0])
    ]


def _decimal(value: float) -> str:
    """As Decimal String, without a negative zero."""
    return f"{round(float(value), 6) + 0.0:.9g}"

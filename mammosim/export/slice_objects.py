"""Breast Tomosynthesis Image objects: the slices reconstructed from a series of projections."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import BreastTomosynthesisImageStorage

from mammosim._version import VERSION
from mammosim.acquisition import Tomosynthesis
from mammosim.export.atomic import whole_file
from mammosim.export.dicom_modules import set_attributes
from mammosim.export.enhanced_modules import (
    SECONDS_PER_PROJECTION,
    finished,
    frame_anatomy,
    item_of,
    sequence_of,
    series_and_equipment,
)
from mammosim.export.identity import StudyIdentity
from mammosim.export.settings import ExportSettings
from mammosim.export.volumes import slices_in_patient
from mammosim.reconstruction import Reconstruction

BITS = 12
"""Bits of a pixel."""

_METHODS = {
    "fdk": ("FILTER_BACK_PROJ", "Feldkamp, Davis and Kress"),
    "sart": ("ITERATIVE", "SART"),
}


def write_slice_object(
    series: Tomosynthesis,
    volume: Reconstruction,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write the slices as one Breast Tomosynthesis Image object.

    Parameters
    ----------
    series : Tomosynthesis
        What they were reconstructed from.
    volume : Reconstruction
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    dataset = slice_dataset(series, volume, study, settings)
    with whole_file(path) as part:
        dataset.save_as(part, enforce_file_format=True)


def slice_dataset(
    series: Tomosynthesis, volume: Reconstruction, study: StudyIdentity, settings: ExportSettings
) -> Dataset:
    """Make the object; the parameters are `write_slice_object`'s."""
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
            "SamplesPerPixel": 1,
            "NumberOfFrames": str(count),
            "Rows": rows,
            "Columns": columns,
            "BitsAllocated": 16,
            "BitsStored": BITS,
            "HighBit": BITS - 1,
            "PixelRepresentation": 0,
            "XRay3DReconstructionSequence": _method(volume),
            "SharedFunctionalGroupsSequence": Sequence([_shared(volume)]),
            "PerFrameFunctionalGroupsSequence": Sequence(_frames(series, volume, settings)),
        },
    ):
        set_attributes(dataset, attributes)
    dataset.PixelData = pixels_of(volume, low, high).astype("<u2", copy=False).tobytes()
    uid = study.uid("image", view.folder, "slices")
    return finished(dataset, BreastTomosynthesisImageStorage, uid)


IMAGE_TYPE = ["DERIVED", "PRIMARY", "TOMOSYNTHESIS", "NONE"]
LARGEST = (1 << BITS) - 1


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
        description += f", {volume.settings.iterations} iterations"
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
            "PixelValueTransformationSequence": sequence_of(
                RescaleIntercept="0", RescaleSlope="1", RescaleType="US"
            ),
            "FrameVOILUTSequence": sequence_of(
                WindowCenter=f"{0.5 * (LARGEST + 1):g}",
                WindowWidth=f"{LARGEST + 1}",
                WindowCenterWidthExplanation="Whole range",
            ),
        }
    )


def _frames(
    series: Tomosynthesis, volume: Reconstruction, settings: ExportSettings
) -> list[Dataset]:
    """Functional groups of each slice."""
    first_mm, steps_mm = slices_in_patient(volume)
    duration_ms = 1e3 * SECONDS_PER_PROJECTION * len(series.gantries)
    return [
        item_of(
            {
                "FrameContentSequence": sequence_of(
                    FrameAcquisitionNumber=1,
                    FrameReferenceDateTime=f"{settings.date}000000",
                    FrameAcquisitionDateTime=f"{settings.date}000000",
                    FrameAcquisitionDuration=duration_ms,
                    StackID="1",
                    InStackPositionNumber=number + 1,
                ),
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

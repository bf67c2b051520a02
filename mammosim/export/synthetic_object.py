"""The synthetic picture of slices as a Digital Mammography X-Ray Image object and as PNG."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import BreastProjectionXRayImageStorageForProcessing

from mammosim.acquisition import Mammogram, Tomosynthesis
from mammosim.export import dicom_modules as modules
from mammosim.export.dicom import acquired, image_dataset
from mammosim.export.dicom_object import decimal_string, save_object
from mammosim.export.dicom_series import series_description
from mammosim.export.identity import StudyIdentity
from mammosim.export.pictures import write_preview
from mammosim.export.settings import ExportSettings
from mammosim.reconstruction import METHOD, Reconstruction, Synthetic, VolumeGrid

SYNTHETIC = "synthetic_2d"
"""Name of its files, without their endings."""

COMMENT = (
    "Simulated image. Synthetic 2D mammogram computed by mammosim from its own slices; not a "
    "radiograph, and not a manufacturer's method."
)


def write_synthetic(
    folder: str | PathLike[str],
    series: Tomosynthesis,
    volume: Reconstruction,
    settings: ExportSettings,
    study: StudyIdentity,
) -> None:
    """Write ``synthetic_2d.dcm`` and ``synthetic_2d.png``; nothing where none was made.

    Parameters
    ----------
    folder : path
    series : Tomosynthesis
    volume : Reconstruction
    settings : ExportSettings
    study : StudyIdentity

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    if volume.synthetic is None:
        return
    folder, picture = Path(folder), _as_mammogram(series, volume.grid, volume.synthetic)
    if settings.dicom:
        dataset = _synthetic_dataset(picture, study, settings)
        save_object(dataset, folder / f"{SYNTHETIC}.dcm")
    if settings.png:
        write_preview(picture, folder / f"{SYNTHETIC}.png")


def _as_mammogram(series: Tomosynthesis, grid: VolumeGrid, made: Synthetic) -> Mammogram:
    """The picture with the technique, load and dose of all projections together."""
    middle, (_, rows, columns) = series.middle, grid.shape
    above = replace(middle.gantry, pixel_mm=grid.pixel_mm, rows=rows, columns=columns)
    whole = float(1 << modules.BITS_STORED["presentation"])
    return replace(
        middle, for_presentation=made.pixels, gantry=above, window_center=0.5 * whole,
        window_width=whole, mas=series.mas, air_kerma_mgy=series.air_kerma_mgy,
        dose_mgy=series.dose_mgy,
    )  # fmt: skip


def _synthetic_dataset(
    picture: Mammogram, study: StudyIdentity, settings: ExportSettings
) -> Dataset:
    """An image object For Presentation, of Image Type GENERATED_2D (PS3.3 C.8.11.7)."""
    attributes = {
        **acquired(picture, "presentation", "synthetic", study, settings),
        **modules.presentation(picture, study),
        **_flat(picture),
        **_own(picture, study),
    }
    uid = study.uid("image", picture.gantry.view.folder, "synthetic")
    return image_dataset(attributes, picture.for_presentation, "presentation", uid)


def _flat(picture: Mammogram) -> dict[str, Any]:
    """Rows and columns are a volume's, all parallel: nothing is magnified, from no distance."""
    spacing = decimal_string(picture.gantry.pixel_mm)
    return {
        "DistanceSourceToDetector": None,
        "DistanceSourceToPatient": None,
        "EstimatedRadiographicMagnificationFactor": "1",
        "PixelSpacing": [spacing, spacing],
        "PixelSpacingCalibrationDescription": "Of the reconstructed slices",
    }


def _own(picture: Mammogram, study: StudyIdentity) -> dict[str, Any]:
    """What differs from a mammogram: its type, and what it was made of."""
    gantry = picture.gantry
    source = modules.source_image(study.uid("image", gantry.view.folder, "raw projections"))
    source.ReferencedSOPClassUID = BreastProjectionXRayImageStorageForProcessing
    source.SpatialLocationsPreserved = "NO"
    return {
        "ImageType": ["DERIVED", "PRIMARY", "", "GENERATED_2D"],
        "SeriesDescription": series_description(gantry.view, " synthetic 2D"),
        "ImageComments": COMMENT,
        "DerivationDescription": f"{modules.DERIVATION} Then slices: {METHOD}.",
        "AcquisitionDeviceProcessingDescription": "Slices, thickness equalization, tone curve",
        "SourceImageSequence": Sequence([source]),
    }

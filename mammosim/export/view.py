"""One view's folder."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.export.contrast import write_contrast
from mammosim.export.dicom import write_dicom
from mammosim.export.gantry_file import write_geometry
from mammosim.export.identity import StudyIdentity
from mammosim.export.label_files import table_of_compressed, write_label_files
from mammosim.export.lesion_masks import lesion_masks
from mammosim.export.matlab import write_matlab
from mammosim.export.measurements import write_measurements
from mammosim.export.path_lengths import write_path_lengths
from mammosim.export.pictures import (
    write_density_tiff,
    write_full_picture,
    write_glandular_tiff,
    write_lesion_lengths_tiff,
    write_lesion_tiff,
    write_mammogram_tiff,
    write_preview,
)
from mammosim.export.presentation_state import write_presentation_state
from mammosim.export.segmentation import write_segmentation
from mammosim.export.settings import ExportSettings
from mammosim.export.tables import write_compression, write_convergence
from mammosim.export.victre import write_victre
from mammosim.export.viewer_files import write_viewer_files
from mammosim.export.volumes import (
    write_displacement,
    write_dose_map,
    write_labels,
    write_lattice,
)
from mammosim.geometry import VoxelFrame
from mammosim.projection import PathLengths
from mammosim.targets import Target


def write_compressed(
    folder: str | PathLike[str],
    compressed: CompressedBreast,
    settings: ExportSettings,
    labels: NDArray[np.uint8] | None = None,
    labels_frame: VoxelFrame | None = None,
    seed: int = 1,
) -> None:
    """Write what is known of a view after compression.

    Parameters
    ----------
    folder : path
        The view's folder, as ``run/LCC``.
    compressed : CompressedBreast
        Also one that has not converged.
    settings : ExportSettings
    labels : ndarray of uint8, [x, y, z], optional
        Labels of the compressed breast, axes of the compression frame; without them there is no
        ``compressed.nii.gz`` nor any other file of them.
    labels_frame : VoxelFrame, optional
        Where those voxels are, compression frame, mm.
    seed : int
        The run's, by which VICTRE names its files.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    folder = Path(folder)
    write_compression(compressed, folder / "compression.json")
    write_convergence(compressed.history, folder / "convergence.csv")
    if settings.matlab:
        write_matlab(compressed, folder / "springs.mat")
    if settings.volumes:
        write_displacement(compressed.field, folder / "displacement.nii.gz")
        write_lattice(compressed.field, folder / "lattice.nii.gz")
    if labels is None or labels_frame is None:
        return
    table, rotation = table_of_compressed(compressed), compressed.view.patient_rotation
    files = []
    formats = [*(["nii.gz"] if settings.volumes else []), *settings.compressed_formats]
    for ending in dict.fromkeys(formats):
        if ending == "victre":
            write_victre(compressed, labels, labels_frame, folder / "victre", seed)
        else:
            path = folder / f"compressed.{ending}"
            write_labels(labels, labels_frame, rotation, path)
            files.append(path.name)
    if files:
        write_label_files(table, tuple(files), folder)
    if settings.volumes and settings.viewers:
        write_viewer_files(table, labels, labels_frame, rotation, folder, "compressed")


def write_images(
    folder: str | PathLike[str],
    paths: PathLengths,
    mammogram: Mammogram,
    targets: Sequence[Target],
    settings: ExportSettings,
    study: StudyIdentity,
) -> None:
    """Write the pictures of one view.

    Parameters
    ----------
    folder : path
        The view's folder, as ``run/LCC``.
    paths : PathLengths
    mammogram : Mammogram
    targets : sequence of Target
        Targets of the run; those of other views are passed over.
    settings : ExportSettings
    study : StudyIdentity

    Raises
    ------
    InputError
        If a file cannot be written, or a lesion of `paths` is not among the targets.
    """
    folder = Path(folder)
    view = mammogram.gantry.view
    here = [target for target in targets if target.view in (view.folder, view.label)]
    masks = lesion_masks(paths, here)
    _write_mammogram(folder, mammogram, settings, study)
    if settings.dicom:
        if masks:
            write_segmentation(masks, mammogram, folder / "lesion_mask.dcm", study, settings)
        if any(lesion.mask.any() for lesion in masks):
            file = folder / "lesion_measurements.dcm"
            write_measurements(masks, mammogram, file, study, settings)
            file = folder / "lesion_outlines.dcm"
            write_presentation_state(masks, mammogram, file, study, settings)
    if settings.tiff:
        write_lesion_tiff(masks, mammogram, folder / "lesion_mask.tif")
    if settings.path_lengths:
        write_path_lengths(paths, folder / "path_lengths.npz")
    if settings.glandular_thickness:
        write_glandular_tiff(paths, folder / "glandular_thickness.tif")
    if settings.volumetric_density:
        write_density_tiff(paths, folder / "volumetric_density.tif")
    if settings.lesion_lengths and masks:
        write_lesion_lengths_tiff(paths, here, folder / "lesion_lengths.tif")


def _write_mammogram(
    folder: Path, mammogram: Mammogram, settings: ExportSettings, study: StudyIdentity
) -> None:
    """Write what follows from the image alone."""
    write_geometry(mammogram.gantry, folder / "geometry.json")
    if settings.dicom:
        write_dicom(mammogram, "processing", folder / "for_processing.dcm", study, settings)
        write_dicom(mammogram, "presentation", folder / "for_presentation.dcm", study, settings)
    write_contrast(mammogram, folder, study, settings)
    if settings.tiff:
        write_mammogram_tiff(mammogram, folder / "mammogram.tif")
    if settings.png:
        write_preview(mammogram, folder / "preview.png")
        write_full_picture(mammogram, folder / "for_presentation.png")
    if settings.dose_map and mammogram.dose is not None and mammogram.dose.dose_map is not None:
        write_dose_map(mammogram.dose.dose_map, mammogram.gantry, folder / "dose_map.nii.gz")


def save_mammogram(mammogram: Mammogram, folder: str | PathLike[str]) -> None:
    """Write an image that belongs to no run; see `Mammogram.save`.

    Parameters
    ----------
    mammogram : Mammogram
    folder : str or path

    Raises
    ------
    InputError
        If a file cannot be written.

    Notes
    -----
    Its identifiers follow from its pixels, so that the same image is the same DICOM objects.
    """
    digest = hashlib.sha256()
    for pixels in (mammogram.for_processing, mammogram.for_presentation):
        digest.update(pixels.tobytes())
    study = StudyIdentity(digest.hexdigest())
    _write_mammogram(Path(folder), mammogram, ExportSettings(), study)


def write_draw(
    folder: str | PathLike[str],
    mammogram: Mammogram,
    number: int,
    settings: ExportSettings,
    study: StudyIdentity,
) -> None:
    """Write the pictures of one draw of a view's noise, as ``for_processing_001.dcm``.

    Parameters
    ----------
    folder : path
        The view's folder, as ``run/LCC``.
    mammogram : Mammogram
    number : int
        Of the draw, from 1; the first is the view's own picture.
    settings : ExportSettings
    study : StudyIdentity

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    folder, end = Path(folder), f"_{number:03d}"
    if settings.dicom:
        raw, shown = folder / f"for_processing{end}.dcm", folder / f"for_presentation{end}.dcm"
        write_dicom(mammogram, "processing", raw, study, settings, number)
        write_dicom(mammogram, "presentation", shown, study, settings, number)
    if settings.tiff:
        write_mammogram_tiff(mammogram, folder / f"mammogram{end}.tif")
    if settings.png:
        write_full_picture(mammogram, folder / f"for_presentation{end}.png")

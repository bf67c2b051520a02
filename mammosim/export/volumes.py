"""Volumes in patient space by ITK: labels, and the displacement field.

The breast frame has +x anterior, +y left, +z superior. ITK, and so this module, speaks LPS: left,
posterior, superior = (y, -x, z). The compression frame's turn about x goes into the direction
cosines, so that a viewer shows each volume where it is in the patient.
"""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray

from mammosim.acquisition import DoseMap
from mammosim.compression import DisplacementField
from mammosim.config import utf8_path
from mammosim.errors import InputError
from mammosim.export.atomic import whole_file
from mammosim.geometry import Gantry, View, VoxelFrame
from mammosim.reconstruction import Reconstruction

LPS_FROM_BREAST: NDArray[np.float64] = np.array(
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
)
"""(3, 3) rotation from breast-frame vectors to LPS."""

_BYTES_AT_ONCE = 1 << 24
"""Voxels are written in pieces of this size, so that no second copy is in memory."""

GZIP_LEVEL = 1
"""Of NIfTI files. Labels of 28 MB take 0.12 s and 3.1 MB with it, 0.57 s and 2.4 MB with 6."""


def write_labels(
    labels: NDArray[np.integer[Any]],
    frame: VoxelFrame,
    rotation: NDArray[np.float64],
    path: str | PathLike[str],
    fields: Mapping[str, str] | None = None,
) -> None:
    """Write labels of the compressed breast, or with the identity those of any volume.

    Parameters
    ----------
    labels : ndarray of whole numbers, [x, y, z]
        Axes of the compression frame.
    frame : VoxelFrame
        Where their voxels are, compression frame, mm.
    rotation : ndarray, (3, 3)
        Breast frame to compression frame (`View.rotation`).
    path : path
        Ends in ``.nii.gz``, ``.nii``, ``.nrrd`` or ``.mha``, which says the format.
    fields : mapping of str to str, optional
        Further fields of an NRRD header.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    _write_scalars(labels, frame, rotation, path, fields)


def write_displacement(field: DisplacementField, path: str | PathLike[str]) -> None:
    """Write the displacement at the nodes of the uncompressed lattice.

    Parameters
    ----------
    field : DisplacementField
    path : path
        Ends in ``.nii.gz``.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    An ITK vector image of 32-bit floats, geometry and vectors in LPS mm. The vector at a point p
    of the uncompressed breast leads to the point p + u(p) of the compressed one: 3D Slicer and
    `sitk.DisplacementFieldTransform` take it as that transform, which resamples a picture of the
    compressed breast onto the uncompressed one.
    """
    to_lps = _lps_from_compression(field.rotation)
    vectors = (field.displacement_mm @ to_lps.T).astype(np.float32)
    image = sitk.GetImageFromArray(
        np.ascontiguousarray(vectors.transpose(2, 1, 0, 3)), isVector=True
    )
    _place(image, field.frame, field.rotation)
    _write(image, path, vectors.nbytes)


def write_lattice(field: DisplacementField, path: str | PathLike[str]) -> None:
    """Write which nodes of the uncompressed lattice are tissue (1) and which are not (0).

    With the displacement it gives the whole field back (`read_displacement`).

    Parameters
    ----------
    field : DisplacementField
        Nodes in the compression frame.
    path : str or path
        The ending sets the format, as for labels.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_labels(field.tissue.astype(np.uint8), field.frame, field.rotation, path)


def write_dose_map(dose: DoseMap, gantry: Gantry, path: str | PathLike[str]) -> None:
    """Write the absorbed dose of each voxel of the compressed breast, mGy, as 32-bit floats.

    Parameters
    ----------
    dose : DoseMap
    gantry : Gantry
        Its view and where it stands.
    path : path
        Ends in ``.nii.gz``.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    shift = np.array([gantry.detector_edge_mm, 0.0, gantry.support_z_mm])
    first = dose.origin_mm + 0.5 * dose.spacing_mm + shift
    nx, ny, nz = dose.mgy.shape
    frame = VoxelFrame(first, dose.spacing_mm, (nx, ny, nz))
    _write_scalars(dose.mgy, frame, gantry.view.rotation, path)


def write_slices(volume: Reconstruction, path: str | PathLike[str]) -> None:
    """Write reconstructed slices, attenuation coefficient in 1/mm, as 32-bit floats.

    Parameters
    ----------
    volume : Reconstruction
    path : path
        Ends in ``.nii.gz``.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    The file's first axis runs along a slice's rows (to higher columns), the second down its
    columns, the third up from the breast support.
    """
    image = sitk.GetImageFromArray(volume.slices)
    first_mm, steps_mm = slices_in_patient(volume)
    spacing_mm = np.linalg.norm(steps_mm, axis=0)
    image.SetSpacing([float(step) for step in spacing_mm])
    image.SetOrigin([float(at) for at in first_mm])
    image.SetDirection([float(cosine) for cosine in (steps_mm / spacing_mm).ravel()])
    _write(image, path, volume.slices.nbytes)


def slices_in_patient(
    volume: Reconstruction,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the voxels of a reconstruction lie in the patient.

    Returns
    -------
    first_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0], LPS, mm.
    steps_mm : ndarray, (3, 3)
        Its columns lead from one column, row and slice to the next, LPS, mm.
    """
    gantry = volume.gantry
    shift = np.array([gantry.detector_edge_mm, 0.0, gantry.support_z_mm])
    corners = volume.grid.gantry_from_voxel([[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]]) + shift
    first, *neighbours = corners @ _lps_from_compression(gantry.view.patient_rotation).T
    return first, np.stack([neighbour - first for neighbour in neighbours], axis=1)


def read_displacement(
    path: str | PathLike[str], lattice: str | PathLike[str], view: View
) -> DisplacementField:
    """Read what `write_displacement` and `write_lattice` wrote.

    Parameters
    ----------
    path, lattice : path
        Displacement, and which nodes are tissue.
    view : View
        View in which it was compressed.

    Raises
    ------
    InputError
        If a file is not there or cannot be read, or both do not belong together.
    """
    vectors, nodes = _read(path), _read(lattice)
    to_lps = _lps_from_compression(view.rotation)
    moved = sitk.GetArrayFromImage(vectors)
    tissue = sitk.GetArrayFromImage(nodes)
    if moved.ndim != 4 or moved.shape != (*tissue.shape, 3):
        raise InputError(
            f"{path}: found an array of {moved.shape} beside {lattice} of {tissue.shape}, expected "
            "the same nodes with three components each"
        )
    frame = VoxelFrame(
        to_lps.T @ np.array(vectors.GetOrigin()),
        np.array(vectors.GetSpacing()),
        (tissue.shape[2], tissue.shape[1], tissue.shape[0]),
    )
    displacement = moved.transpose(2, 1, 0, 3).astype(np.float32) @ to_lps.astype(np.float32)
    return DisplacementField(
        frame, np.ascontiguousarray(displacement), tissue.transpose(2, 1, 0) > 0, view.rotation
    )


def read_compressed_labels(
    path: str | PathLike[str], view: View
) -> tuple[NDArray[np.uint8], VoxelFrame]:
    """Read labels of a compressed breast back.

    Parameters
    ----------
    path : str or path
        A view's ``compressed.nii.gz``, in any of the formats of volumes.
    view : View
        Its patient rotation turns the file's axes into the compression frame's.

    Returns
    -------
    labels : ndarray of uint8, [x, y, z]
        Axes of the compression frame.
    frame : VoxelFrame
        Where their voxels are, compression frame, mm.
    """
    image = _read(path)
    labels = sitk.GetArrayFromImage(image).transpose(2, 1, 0)
    to_lps = _lps_from_compression(view.patient_rotation)
    origin = to_lps.T @ np.array(image.GetOrigin())
    nx, ny, nz = labels.shape
    return labels, VoxelFrame(origin, np.array(image.GetSpacing()), (nx, ny, nz))


def _read(path: str | PathLike[str]) -> sitk.Image:
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; export.volumes must have been true for this run")
    try:
        return sitk.ReadImage(utf8_path(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise InputError(f"{path}: cannot be read ({reason})") from None


def _lps_from_compression(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation from compression-frame vectors to LPS, from `View.rotation`."""
    return LPS_FROM_BREAST @ rotation.T


def _place(image: sitk.Image, frame: VoxelFrame, rotation: NDArray[np.float64]) -> None:
    to_lps = _lps_from_compression(rotation)
    image.SetSpacing([float(step) for step in frame.spacing_mm])
    image.SetOrigin([float(at) for at in to_lps @ frame.origin_mm])
    image.SetDirection([float(cosine) for cosine in to_lps.ravel()])


def _write_scalars(
    values: NDArray[Any],
    frame: VoxelFrame,
    rotation: NDArray[np.float64],
    path: str | PathLike[str],
    fields: Mapping[str, str] | None = None,
) -> None:
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)))
    for key, text in (fields or {}).items():
        image.SetMetaData(key, text)
    _place(image, frame, rotation)
    _write(image, path, values.nbytes)


def _write(image: sitk.Image, path: str | PathLike[str], data_bytes: int) -> None:
    with whole_file(path) as part:
        if part.name.endswith(".nii.gz"):
            plain = part.with_suffix("")
            try:
                _write_by_itk(image, plain, data_bytes)
                _zip(plain, part)
            finally:
                plain.unlink(missing_ok=True)
        else:
            _write_by_itk(image, part, data_bytes)


def _write_by_itk(image: sitk.Image, path: Path, data_bytes: int) -> None:
    try:
        sitk.WriteImage(image, utf8_path(path), useCompression=True)
    except RuntimeError as error:
        raise OSError(str(error).strip().splitlines()[-1]) from error
    # Of its formats, ITK does not notice a full disk where it writes NIfTI.
    if path.suffix == ".nii" and path.stat().st_size < data_bytes:
        free_mb = shutil.disk_usage(path.parent).free // 1_000_000
        raise OSError(f"written incompletely; {free_mb} MB free on the disk")


def _zip(plain: Path, zipped: Path) -> None:
    """Compress a file; the same content gives the same bytes, whenever and by what name."""
    with (
        plain.open("rb") as source,
        zipped.open("wb") as target,
        gzip.GzipFile("", "wb", GZIP_LEVEL, target, mtime=0) as stream,
    ):
        shutil.copyfileobj(source, stream, _BYTES_AT_ONCE)

"""Volumes in patient space by ITK: labels, and the displacement field.

The breast frame has +x anterior, +y left, +z superior. ITK, and so this module, speaks LPS: left,
posterior, superior = (y, -x, z). The compression frame's turn about x goes into the direction
cosines, so that a viewer shows each volume where it is in the patient.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import SimpleITK as sitk
from isal.igzip import IGzipFile
from numpy.typing import NDArray

from mammosim.acquisition import DoseMap
from mammosim.compression import DisplacementField
from mammosim.config import utf8_path
from mammosim.errors import InputError
from mammosim.export._axes_kernels import exchange_axes
from mammosim.export.atomic import whole_file
from mammosim.geometry import Gantry, View, VoxelFrame
from mammosim.reconstruction import Reconstruction

LPS_FROM_BREAST: NDArray[np.float64] = np.array(
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
)
"""(3, 3) rotation from breast-frame vectors to LPS."""

_BYTES_AT_ONCE = 1 << 24
"""Voxels are written in pieces of this size, so that no second copy is in memory."""

_NIFTI_SIZES = 42
"""Where a NIfTI-1 header keeps the sizes along x, y and z, `dim[1..3]`, as 16-bit numbers."""

GZIP_LEVEL = 1
"""Of NIfTI files, ISA-L's. Labels of 200 MB take 0.23 s and 10.8 MB with it, 0.87 s and 12.0 MB
with zlib's own level 1."""


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
    _write(image, path)


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
    _write(image, path)


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
    if Path(path).name.endswith((".nii", ".nii.gz")):
        _write_nifti(values, frame, rotation, path)
        return
    image = sitk.GetImageFromArray(x_fastest(values))
    for key, text in (fields or {}).items():
        image.SetMetaData(key, text)
    _place(image, frame, rotation)
    _write(image, path)


def _write_nifti(
    values: NDArray[Any],
    frame: VoxelFrame,
    rotation: NDArray[np.float64],
    path: str | PathLike[str],
) -> None:
    """Write scalars as ITK would, a few layers at a time: no copy of them is in memory or on disk.

    ITK writes the header, that of a single voxel; where NIfTI-1 keeps the size, it is filled in.
    """
    layers = max(_BYTES_AT_ONCE // values[:, :, :1].nbytes, 1)
    with whole_file(path) as part:
        one = sitk.GetImageFromArray(np.zeros((1, 1, 1), values.dtype))
        _place(one, frame, rotation)
        alone = part.with_name(f"{part.name}.header.nii")
        try:
            _write_by_itk(one, alone)
            header = bytearray(alone.read_bytes()[: -values.itemsize])
        finally:
            alone.unlink(missing_ok=True)
        sizes = np.array(values.shape, np.int16).tobytes()
        header[_NIFTI_SIZES : _NIFTI_SIZES + len(sizes)] = sizes
        with _opened(part) as stream:
            stream.write(header)
            for low in range(0, values.shape[2], layers):
                stream.write(x_fastest(values[:, :, low : low + layers]).data)


@contextmanager
def _opened(part: Path) -> Iterator[BinaryIO | IGzipFile]:
    """A file to write to, compressed where its name says so."""
    with part.open("wb") as file:
        if part.suffix != ".gz":
            yield file
            return
        # Without name and time: the same content gives the same bytes.
        with IGzipFile("", "wb", GZIP_LEVEL, file, mtime=0) as stream:
            yield stream


def x_fastest(values: NDArray[Any]) -> NDArray[Any]:
    """Copy of an array [x, y, z] as [z, y, x] with x contiguous, as files hold volumes."""
    turned = np.empty(values.shape[::-1], values.dtype)
    exchange_axes(values, turned)
    return turned


def _write(image: sitk.Image, path: str | PathLike[str]) -> None:
    """Write a small image, or one of a format that ITK itself compresses."""
    with whole_file(path) as part:
        if not part.name.endswith(".nii.gz"):
            _write_by_itk(image, part)
            return
        plain = part.with_suffix("")
        try:
            _write_by_itk(image, plain)
            with plain.open("rb") as source, _opened(part) as stream:
                shutil.copyfileobj(source, stream, _BYTES_AT_ONCE)
        finally:
            plain.unlink(missing_ok=True)


def _write_by_itk(image: sitk.Image, path: Path) -> None:
    try:
        sitk.WriteImage(image, utf8_path(path), useCompression=True)
    except RuntimeError as error:
        raise OSError(str(error).strip().splitlines()[-1]) from error
    # Of its formats, ITK does not notice a full disk where it writes NIfTI.
    voxel_bytes = image.GetSizeOfPixelComponent() * image.GetNumberOfComponentsPerPixel()
    if path.suffix == ".nii" and path.stat().st_size < image.GetNumberOfPixels() * voxel_bytes:
        free_mb = shutil.disk_usage(path.parent).free // 1_000_000
        raise OSError(f"written incompletely; {free_mb} MB free on the disk")

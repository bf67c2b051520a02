"""Shapes of lesions from voxel files: masks, and HDF5 files of VICTRE's libraries."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.lesion_shapes.shape import Grid, LesionShape
from mammosim.phantom.memory import check_memory
from mammosim.phantom.readers import BREAST_AXES, open_voxels
from mammosim.phantom.readers.axes import turn

HDF5_ENDINGS = (".h5", ".hdf5")
HDF5_DATASET = "volume"
"""Where VICTRE's files of lesions hold the voxels (VICTRE_PIPELINE, Victre/Pipeline.py)."""

POINTS_PER_VOXEL = 4
"""Points along each edge of a voxel of the breast, at least, that stand for the mask."""

POINTS_AT_ONCE = 1 << 20
"""Points that are looked up together, to bound memory."""


def read_mask(path: Path, voxel_mm: float | None = None) -> LesionShape:
    """Read a mask: voxels of whole numbers other than 0, or parts from 0 to 1 that are filled.

    Parameters
    ----------
    path : path
        A file that a phantom may be read from too, or HDF5 with a dataset ``volume``.
    voxel_mm : float, optional
        Edge of its voxels, mm, in place of what the file says.

    Raises
    ------
    InputError
        If the file cannot be used, holds no lesion, or says no voxel size and none is given.
    """
    values, spacing_mm = _read(path, voxel_mm)
    parts = _parts(values, path)
    index = np.argwhere(parts > 0.0)
    if len(index) == 0:
        raise InputError(
            f"{path}: all {parts.size} voxels are 0, expected voxels of a lesion, other than 0"
        )
    weights = parts[tuple(index.T)]
    points = index * spacing_mm
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    corner = 0.5 * float(np.linalg.norm(spacing_mm))
    radius = float(np.linalg.norm(points - centre, axis=1).max()) + corner
    volume = float(weights.sum() * np.prod(spacing_mm))
    return LesionShape(centre, radius, volume, partial(_filled, points, weights, spacing_mm))


def _read(path: Path, voxel_mm: float | None) -> tuple[NDArray[np.generic], NDArray[np.float64]]:
    """Values [x, y, z] and voxel size, mm; axes as the file says, else as in the array."""
    if path.name.lower().endswith(HDF5_ENDINGS):
        values, spacing = _hdf5(path), None
    else:
        opened = open_voxels(path)
        check_memory(opened, 1)
        try:
            loaded = opened.load(1).values
        except (OSError, MemoryError) as error:
            raise InputError(f"{path}: cannot be read ({error or 'no memory'})") from None
        axes = opened.axes or BREAST_AXES
        values, turned_mm, _ = turn(loaded, opened.voxel_mm, np.zeros(3), axes)
        spacing = turned_mm if opened.says_voxel else None
    if voxel_mm is not None:
        spacing = np.full(3, voxel_mm)
    if spacing is None:
        raise InputError(f"{path}: does not give its voxel size; set the lesion's voxel_mm")
    return values, spacing


def _hdf5(path: Path) -> NDArray[np.generic]:
    """The dataset of VICTRE's files, whose axes are z, y, x as in its phantoms' arrays."""
    try:
        import h5py  # imported when needed: an extra
    except ImportError:
        raise InputError(
            f"{path}: HDF5 files need h5py, which is not installed: pip install h5py"
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with h5py.File(path, "r") as file:
            stored = file[HDF5_DATASET]
            if getattr(stored, "ndim", 0) != 3 or stored.dtype.kind not in "iufb":
                raise ValueError(f"'{HDF5_DATASET}' is not a three-dimensional array of numbers")
            values: NDArray[np.generic] = np.asarray(stored[()])
    except (OSError, KeyError, ValueError, MemoryError) as error:
        raise InputError(
            f"{path}: cannot be read, expected HDF5 with the voxels in '{HDF5_DATASET}' ({error})"
        ) from None
    return values.transpose(2, 1, 0)


def _parts(values: NDArray[np.generic], path: Path) -> NDArray[np.float64]:
    """Part of each voxel that is filled."""
    if values.dtype.kind != "f":
        return (values != 0).astype(np.float64)
    parts = values.astype(np.float64)
    if not (np.isfinite(parts) & (parts >= 0.0)).all() or (
        parts.max(initial=0.0) > 1.0 and (parts != np.rint(parts)).any()
    ):
        raise InputError(
            f"{path}: found values from {np.nanmin(parts):g} to {np.nanmax(parts):g}, expected "
            f"whole numbers, or fractions of a voxel from 0 to 1"
        )
    return np.minimum(parts, 1.0)


def _filled(
    points_mm: NDArray[np.float64],
    weights: NDArray[np.float64],
    spacing_mm: NDArray[np.float64],
    placing: NDArray[np.float64],
    grid: Grid,
) -> NDArray[np.float64]:
    """Part of each voxel, from points evenly spaced in the mask's voxels."""
    edges = np.abs(placing[:, :3] * spacing_mm).max(axis=0)  # of a mask's voxel, in the grid's
    counts = np.maximum(1, np.ceil(POINTS_PER_VOXEL * edges)).astype(int)
    within = [(np.arange(count) + 0.5) / count - 0.5 for count in counts]
    inner = np.stack(np.meshgrid(*within, indexing="ij"), axis=-1).reshape(-1, 3) * spacing_mm
    inner = inner @ placing[:, :3].T
    volume = abs(float(np.linalg.det(placing[:, :3]))) * float(np.prod(spacing_mm)) / len(inner)
    filled = np.zeros(int(np.prod(grid)))
    step = max(1, POINTS_AT_ONCE // len(inner))
    for start in range(0, len(points_mm), step):
        middles = points_mm[start : start + step] @ placing[:, :3].T + placing[:, 3]
        index = np.rint(middles[:, None] + inner).astype(np.int64).reshape(-1, 3)
        weight = np.repeat(weights[start : start + step], len(inner)) * volume
        inside = ((index >= 0) & (index < grid)).all(axis=1)
        flat = np.ravel_multi_index(tuple(index[inside].T), grid)
        filled += np.bincount(flat, weight[inside], filled.size)
    return filled.reshape(grid)

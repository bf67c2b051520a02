"""Shapes of lesions from files: masks of voxels and closed surfaces."""

from __future__ import annotations

from pathlib import Path

from mammosim.errors import InputError
from mammosim.phantom.lesion_shapes.mask import HDF5_ENDINGS, read_mask
from mammosim.phantom.lesion_shapes.mesh import MESH_ENDINGS, OTHER_MESH_ENDINGS, read_mesh
from mammosim.phantom.lesion_shapes.paint import paint_shape
from mammosim.phantom.lesion_shapes.shape import LesionShape
from mammosim.phantom.readers import open_voxels


def read_shape(path: str | Path, voxel_mm: float | None = None) -> LesionShape:
    """Read the shape of a lesion.

    Parameters
    ----------
    path : path
        Its ending decides: STL, OBJ, PLY and OFF are closed surfaces in mm, all else voxels.
    voxel_mm : float, optional
        Edge of the voxels of a mask, mm, in place of what the file says.

    Raises
    ------
    InputError
        If the file cannot be used.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending in OTHER_MESH_ENDINGS:
        raise InputError(
            f"{path}: meshes are read as {', '.join(MESH_ENDINGS)}; convert it, e.g. with `meshio "
            f"convert {path.name} {path.stem}.stl` (surfaces) or in ParaView"
        )
    if ending not in MESH_ENDINGS:
        return read_mask(path, voxel_mm)
    if voxel_mm is not None:
        raise InputError(f"{path}: is a surface; voxel_mm does not apply to it")
    return read_mesh(path)


def shape_files(path: str | Path) -> tuple[Path, ...]:
    """All files that a lesion's file consists of.

    Parameters
    ----------
    path : str or Path
        A mask of voxels or a closed surface.

    Returns
    -------
    tuple of Path
        The file itself; for a format with header and data apart, such as MetaImage, both; for a
        folder of slices, all of them.

    Raises
    ------
    InputError
        If a mask's header cannot be read.
    """
    path = Path(path)
    if path.name.lower().endswith((*MESH_ENDINGS, *OTHER_MESH_ENDINGS, *HDF5_ENDINGS)):
        return (path,)
    return tuple(open_voxels(path).files)


__all__ = ["LesionShape", "paint_shape", "read_shape", "shape_files"]

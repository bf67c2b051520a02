"""Shapes of lesions from closed surface meshes: STL, OBJ, PLY and OFF."""

from __future__ import annotations

import struct
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.config import open_file
from mammosim.errors import InputError
from mammosim.phantom.lesion_shapes.shape import Grid, LesionShape

MESH_ENDINGS = (".stl", ".obj", ".ply", ".off")

OTHER_MESH_ENDINGS = (".vtk", ".vtu", ".vtp", ".msh", ".inp", ".step", ".stp", ".3mf", ".glb")
"""Meshes that are not read: volume meshes, CAD solids and scenes."""

MAX_BYTES = 500_000_000
"""Of a file; a surface of a million triangles has 50 MB."""

LINES_PER_VOXEL, MAX_LINES = 4, 1000
"""Lines along x through each voxel of the breast, along each of its edges, on which the surface
is met, but no more along an edge of the grid. Along x the filled part is exact."""

LINE_SHIFT = (0.0314159, 0.0271828)
"""By what part of their distance the lines are moved off their even places: then none meets an edge
of a mesh whose vertices have round coordinates, where it might count twice."""

CANDIDATES_AT_ONCE = 1 << 20
"""Voxels that are tested together, to bound memory."""

DAMAGE = (
    ValueError, TypeError, IndexError, KeyError, AttributeError, OSError, EOFError,
    NotImplementedError, ZeroDivisionError, MemoryError, struct.error,
)  # fmt: skip
"""What trimesh raises on damaged files."""


def read_mesh(path: Path) -> LesionShape:
    """Read a closed surface; its coordinates are mm.

    Parameters
    ----------
    path : path
        Ends in one of `MESH_ENDINGS`.

    Raises
    ------
    InputError
        If the file cannot be used, or the surface has holes or encloses nothing.
    """
    mesh = _load(path)
    if not mesh.is_watertight:
        edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        odd = int(np.count_nonzero(counts != 2))
        raise InputError(
            f"{path}: the surface has holes: {odd} of {len(edges)} edges do not join two "
            "triangles, expected a closed surface; close it, e.g. with MeshLab or trimesh"
        )
    if not mesh.is_winding_consistent:
        raise InputError(
            f"{path}: its triangles face both ways, expected a consistently oriented surface; "
            f"orient it, e.g. with MeshLab or trimesh"
        )
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    volume = float(mesh.volume)
    if not np.isfinite(vertices).all() or not abs(volume) > 0.0:
        raise InputError(f"{path}: encloses {volume:g} mm3, expected more than 0")
    faces = np.asarray(mesh.faces)[:, :: 1 if volume > 0.0 else -1]  # outside outwards
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    return LesionShape(centre, radius, abs(volume), partial(_filled, vertices, faces))


def _load(path: Path) -> Any:
    import trimesh  # imported when needed: it takes a moment

    try:
        with open_file(path) as stream:
            content = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if len(content) > MAX_BYTES:
        raise InputError(f"{path}: holds more than {MAX_BYTES // 1_000_000} MB, expected less")
    errors = (*DAMAGE, trimesh.exchange.stl.HeaderError)
    try:
        mesh = trimesh.load_mesh(BytesIO(content), file_type=path.suffix[1:].lower())
    except errors as error:
        raise InputError(f"{path}: cannot be read as a surface ({error or 'damaged'})") from None
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError(f"{path}: holds no triangles, expected a closed surface")
    mesh.merge_vertices()
    return mesh


def _filled(
    vertices_mm: NDArray[np.float64],
    faces: NDArray[np.int64],
    placing: NDArray[np.float64],
    grid: Grid,
) -> NDArray[np.float64]:
    """Part of each voxel inside the surface.

    Notes
    -----
    On a line along x, what lies behind each triangle that it meets is counted, with the sign of
    the side that the triangle shows; inside a closed surface the sum is one. The volume enclosed
    is that of the prisms behind all triangles (Gauss' theorem).
    """
    vertices = vertices_mm @ placing[:, :3].T + placing[:, 3]
    if np.linalg.det(placing[:, :3]) < 0.0:
        faces = faces[:, ::-1]
    # Lines have whole numbers along u and v.
    per_voxel = int(np.clip(MAX_LINES // max(grid[1:]), 1, LINES_PER_VOXEL))
    u, v = (
        (vertices[:, axis] + 0.5) * per_voxel - 0.5 - shift
        for axis, shift in zip((1, 2), LINE_SHIFT, strict=True)
    )
    lines = (grid[1] * per_voxel, grid[2] * per_voxel)
    triangles = np.stack([vertices[:, 0], u, v], axis=1)[faces]
    low = np.clip(np.ceil(triangles[:, :, 1:].min(axis=1)), 0, lines).astype(np.int64)
    high = np.clip(np.floor(triangles[:, :, 1:].max(axis=1)) + 1, 0, lines).astype(np.int64)
    sides = np.maximum(high - low, 0)
    behind = np.zeros((grid[0] + 1) * grid[1] * grid[2])
    for part in _parts(np.prod(sides, axis=1)):
        _add_prisms(triangles[part], low[part], sides[part], grid, per_voxel, behind)
    filled = np.cumsum(behind.reshape(grid[0] + 1, grid[1], grid[2]), axis=0)[:-1]
    return np.clip(filled / per_voxel**2, 0.0, 1.0)


def _parts(counts: NDArray[np.int64]) -> list[slice]:
    """Triangles that meet up to some number of lines together, those that meet none left out."""
    total = np.cumsum(counts)
    cuts = np.searchsorted(total, np.arange(1, total[-1] // CANDIDATES_AT_ONCE + 1)
                           * CANDIDATES_AT_ONCE)  # fmt: skip
    ends = np.unique([0, *cuts, len(counts)])
    return [slice(first, last) for first, last in pairwise(ends)]


def _add_prisms(
    triangles: NDArray[np.float64],
    low: NDArray[np.int64],
    sides: NDArray[np.int64],
    grid: Grid,
    per_voxel: int,
    behind: NDArray[np.float64],
) -> None:
    """Add to `behind`, whose sum along x is the filled length, what lies behind triangles."""
    counts = np.prod(sides, axis=1)
    owner = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    at = low[owner] + np.stack(np.divmod(place, np.maximum(sides[owner, 1], 1)), axis=1)
    corner = triangles[owner]
    a, b, c = (corner[:, number, 1:] - at for number in range(3))
    areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    met = (areas > 0.0).all(axis=1) | (areas < 0.0).all(axis=1)
    areas, corner, at = areas[met], corner[met], at[met]
    x = (areas * corner[:, :, 0]).sum(axis=1) / areas.sum(axis=1)
    # A positive area shows the triangle's outside to +x: there the line leaves the shape.
    sign = -np.sign(areas[:, 0])
    first = np.clip(np.floor(x + 0.5), 0, grid[0]).astype(np.int64)
    part = np.clip(first + 0.5 - x, 0.0, 1.0)
    line = np.ravel_multi_index((at // per_voxel).T, grid[1:])
    plane = grid[1] * grid[2]
    behind += np.bincount(first * plane + line, sign * part, len(behind))
    rest = first < grid[0]
    behind += np.bincount(
        (first[rest] + 1) * plane + line[rest], (sign * (1.0 - part))[rest], len(behind)
    )


def _cross(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the signed area of a triangle with a corner at the origin."""
    area: NDArray[np.float64] = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return area

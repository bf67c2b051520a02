"""The compressed breast on a coarse grid: how much of each material a voxel holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.projection._coarse_kernels import SampledAs, carry_density, fold_labels
from mammosim.projection._grid_kernels import carry_labels
from mammosim.projection.channels import Channels, channels_of, host_channel
from mammosim.projection.voxel_map import VoxelMap, voxel_map

MAX_MATERIALS = 15
"""Materials that the shares of a voxel can tell apart, four bits each."""

MAX_VOXELS = 16_000_000
"""Most coarse voxels: their labels, shares and densities take 20 bytes each, 320 MB."""

MAX_IN_PLATE_MM = 3.0
"""How deep in a plate tissue may lie so that the plate is taken to push it away, mm: half a cell of
a coarse lattice, and more."""

_LEVEL_MM, _COLUMNS_WITHIN = 0.25, 0.95
"""Step in which depths in a plate are measured, and the share of columns that reach no deeper."""

# Parts of a step by which the columns of a block of 2 x 2 are shifted along z.
_STAGGER = {(0, 0): -0.375, (1, 1): -0.125, (0, 1): 0.125, (1, 0): 0.375}

BEHIND_EDGE_MM = 30.0
"""How far tissue behind the detector's edge is kept, mm; two mean free paths of 20 keV photons."""

BESIDE_FIELD_MM = 30.0
"""How far tissue beside the field is kept, mm."""


@dataclass(frozen=True, eq=False)
class CoarseBreast:
    """Tissue between the plates on a grid of coarse voxels.

    Parameters
    ----------
    origin_mm : ndarray, (3,)
        Lowest corner of the grid, **gantry frame**, mm.
    spacing_mm : ndarray, (3,)
        Edges of a voxel, mm.
    materials : tuple of str
        Materials that are distinguished.
    shares : ndarray of uint64, [x, y, z]
        How many eighths of a voxel each material fills: four bits a material, the first lowest.
    density : ndarray of float32, [x, y, z]
        Density against that before compression.
    """

    origin_mm: NDArray[np.float64]
    spacing_mm: NDArray[np.float64]
    materials: tuple[str, ...]
    shares: NDArray[np.uint64]
    density: NDArray[np.float32]

    def fraction(self, material: str) -> NDArray[np.float64]:
        """[x, y, z] volume fraction of a material."""
        shift = np.uint64(4 * self.materials.index(material))
        return ((self.shares >> shift) & np.uint64(15)) / 8.0


def coarse_breast(compressed: CompressedBreast, gantry: Gantry, voxel_mm: float) -> CoarseBreast:
    """Copy the compressed breast onto a coarse grid, for radiation transport.

    Parameters
    ----------
    compressed : CompressedBreast
    gantry : Gantry
    voxel_mm : float
        Edge of a coarse voxel, mm; along the plates' normal as near to it as divides the gap.

    Returns
    -------
    CoarseBreast

    Raises
    ------
    InputError
        If the grid would have more than `MAX_VOXELS` voxels.

    Notes
    -----
    Eight points of each voxel are looked up, so that fractions are eighths and no tissue is lost
    on average however thin it is. What a mechanical model leaves inside the plates, up to
    `MAX_IN_PLATE_MM`, is pushed out of them: heights are scaled into the gap, densities by the
    inverse, so that the copy attenuates as the path lengths do. Other tissue above the paddle's or
    below the support's face is left out, as is what lies more than `BEHIND_EDGE_MM` behind the
    detector's edge or more than `BESIDE_FIELD_MM` beside the field.
    """
    mapped = voxel_map(compressed)
    low, high = _box_mm(compressed, mapped, gantry, voxel_mm)
    nx, ny, nz = _counts(low, high, voxel_mm)
    spacing = np.array([voxel_mm, voxel_mm, (high[2] - low[2]) / nz])
    below, above = _in_plates_mm(compressed, mapped, gantry, low, (nx, ny))
    scale = (high[2] + below + above) / high[2] if high[2] > 0.0 else 1.0
    first = low + gantry.origin_mm - [0.0, 0.0, below]
    step = spacing * [1.0, 1.0, scale]
    labels = _staggered_labels(compressed, mapped, first, 0.5 * step, (2 * nx, 2 * ny, 2 * nz))
    halves = np.empty((nx, ny, 2 * nz), np.float32)
    carry_density(*_axes(mapped, first, step * [1.0, 1.0, 0.5], halves.shape), mapped.nodes, halves)
    density = scale * _of_tissue(halves, labels)
    materials, sampled = _sampled_as(compressed, channels_of(compressed.phantom))
    return CoarseBreast(low, spacing, materials, fold(labels, sampled), density)


def _staggered_labels(
    compressed: CompressedBreast,
    mapped: VoxelMap,
    first_mm: NDArray[np.float64],
    step_mm: NDArray[np.float64],
    shape: tuple[int, int, int],
) -> NDArray[np.uint8]:
    """Labels at the points of a grid whose columns are shifted along z by parts of a step.

    Skin lies flat under the plates: columns with points at the same heights would count it up to a
    quarter too thick or too thin.
    """
    labels = np.empty(shape, np.uint8)
    u, v, k = _axes(mapped, first_mm, step_mm, shape)
    last = mapped.frame.shape[2] - 1.0
    for (a, b), part in _STAGGER.items():
        some = np.empty((shape[0] // 2, shape[1] // 2, shape[2]), np.uint8)
        shifted = np.clip(k + part * step_mm[2] / mapped.frame.spacing_mm[2], 0.0, last)
        carry_labels(u[a::2], v[b::2], shifted, mapped.nodes, compressed.phantom.labels, some)
        labels[a::2, b::2] = some
    return labels


def _of_tissue(halves: NDArray[np.float32], labels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """[x, y, z] mean of a voxel's lower and upper half, as much of each as holds tissue."""
    nx, ny, nz = (size // 2 for size in labels.shape)
    tissue = np.zeros((nx, ny, nz, 2), np.float32)
    for a in range(2):
        for b in range(2):
            tissue += labels[a::2, b::2].reshape(tissue.shape) > 0
    there = tissue.sum(axis=-1)
    mean = (halves.reshape(tissue.shape) * tissue).sum(axis=-1)
    return np.divide(mean, there, out=np.ones_like(mean), where=there > 0.0)


def check_coarse_size(compressed: CompressedBreast, gantry: Gantry, voxel_mm: float) -> None:
    """Refuse a breast whose coarse copy would be too large, without making it.

    Raises
    ------
    InputError
        As `coarse_breast` does.
    """
    _counts(*_box_mm(compressed, voxel_map(compressed), gantry, voxel_mm), voxel_mm)


def _counts(
    low_mm: NDArray[np.float64], high_mm: NDArray[np.float64], voxel_mm: float
) -> tuple[int, int, int]:
    """Voxels along each axis."""
    counts = np.maximum(np.ceil((high_mm - low_mm) / voxel_mm - 1e-6), 1.0)
    if np.prod(counts) > MAX_VOXELS:
        raise InputError(
            f"acquisition.scatter: the compressed breast needs {np.prod(counts):.3g} voxels of "
            f"{voxel_mm:g} mm, at most {MAX_VOXELS:.3g} are allowed; use model: kernels"
        )
    nx, ny, nz = (int(count) for count in counts)
    return nx, ny, nz


def _in_plates_mm(
    compressed: CompressedBreast,
    mapped: VoxelMap,
    gantry: Gantry,
    low_mm: NDArray[np.float64],
    columns: tuple[int, int],
) -> tuple[float, float]:
    """How deep tissue reaches into support and paddle, mm: less in 19 columns of 20.

    Columns count that end within `MAX_IN_PLATE_MM` of the plate's face; the others bulge past a
    plate that is not there.
    """
    x = low_mm[0] + (np.arange(columns[0]) + 0.5)
    under = x > compressed.plate_edge_mm - gantry.detector_edge_mm
    levels = round(MAX_IN_PLATE_MM / _LEVEL_MM) + 1
    step = np.array([1.0, 1.0, _LEVEL_MM])
    depths = []
    for face_mm, down in ((0.0, True), (compressed.thickness_mm, False)):
        first = np.array([low_mm[0], low_mm[1], face_mm - (levels * _LEVEL_MM if down else 0.0)])
        labels = np.empty((*columns, levels), np.uint8)
        carry_labels(
            *_axes(mapped, first + gantry.origin_mm, step, labels.shape),
            mapped.nodes, compressed.phantom.labels, labels,
        )  # fmt: skip
        tissue = labels[under] > 0
        tissue = tissue[..., ::-1] if down else tissue  # from the face into the plate
        inside = tissue[..., :-1][tissue[..., 0] & ~tissue[..., -1]]
        deep = inside.mean(axis=0) > 1.0 - _COLUMNS_WITHIN if len(inside) else np.zeros(1, bool)
        depths.append(_LEVEL_MM * float(np.argmin(np.append(deep, False))))
    return depths[0], depths[1]


def fold(labels: NDArray[np.uint8], sampled: SampledAs) -> NDArray[np.uint64]:
    """Shares [x, y, z] of blocks of 2 x 2 x 2 labels."""
    nx, ny, nz = (size // 2 for size in labels.shape)
    shares = np.empty((nx, ny, nz), np.uint64)
    fold_labels(labels, sampled, shares)
    return shares


def _box_mm(
    compressed: CompressedBreast, mapped: VoxelMap, gantry: Gantry, voxel_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of what is copied, gantry frame, mm."""
    bounds = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        cells = np.flatnonzero(mapped.tissue.any(axis=others))
        bounds.append((cells[0], cells[-1] + 1))
    index_low, index_high = np.array(bounds).T
    low = mapped.frame.position_mm(index_low) - gantry.origin_mm
    high = mapped.frame.position_mm(index_high) - gantry.origin_mm
    low[0] = max(low[0], -BEHIND_EDGE_MM)
    high[0] = min(high[0], gantry.x_max_mm + BESIDE_FIELD_MM)
    low[1] = max(low[1], gantry.y_min_mm - BESIDE_FIELD_MM)
    high[1] = min(high[1], gantry.y_max_mm + BESIDE_FIELD_MM)
    # The detector's edge is a plane between voxels, so that none is cut by the beam's edge.
    low[:2] = np.floor(np.minimum(low[:2], [0.0, np.inf]) / voxel_mm) * voxel_mm
    low[2], high[2] = 0.0, compressed.thickness_mm
    return low, np.maximum(high, low)


def _axes(
    mapped: VoxelMap,
    low_mm: NDArray[np.float64],
    spacing_mm: NDArray[np.float64],
    shape: tuple[int, ...],
) -> list[NDArray[np.float64]]:
    """Centres of voxels along each axis as fractional nodes, held inside the grid."""
    last = np.array(mapped.frame.shape) - 1.0
    axes = []
    for axis, count in enumerate(shape):
        place = low_mm[axis] + (np.arange(count) + 0.5) * spacing_mm[axis]
        index = (place - mapped.frame.origin_mm[axis]) / mapped.frame.spacing_mm[axis]
        axes.append(np.clip(index, 0.0, last[axis]))
    return axes


def _sampled_as(
    compressed: CompressedBreast, channels: Channels
) -> tuple[tuple[str, ...], SampledAs]:
    """Materials that occur, and what each label counts as."""
    materials = tuple(dict.fromkeys(channels.materials))
    material = np.full(256, -1, np.int64)
    host, fill = material.copy(), np.ones(256)
    for label in range(256):
        channel = int(channels.of_label[label])
        if channel < len(channels):
            material[label] = materials.index(channels.materials[channel])
    for order, shares in enumerate(channels.shares):  # mixtures of two: one fills part of the other
        label = int(np.flatnonzero(channels.of_label == len(channels) + order)[0])
        part, rest = np.argsort(-shares)[[1, 0]]
        material[label] = materials.index(channels.materials[part])
        host[label] = materials.index(channels.materials[rest])
        fill[label] = shares[part]
    for lesion in channels.lesions:
        if lesion is None or lesion.fill == 1.0:
            continue
        around = host_channel(compressed.phantom, lesion, channels)
        if around is not None:
            host[lesion.label] = materials.index(channels.materials[around])
            fill[lesion.label] = lesion.fill
    return materials, SampledAs(material, host, fill)

"""The mechanical lattice of a phantom: nodes, their moduli, and which of them are held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression._lattice_kernels import gather_blocks, tissue_outline
from mammosim.compression.connectivity import held_together
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom, abdominal_counts, label_counts
from mammosim.tissues import Moduli

SMALLEST_PART = 0.5
"""A node is tissue where at least this part of its block is."""

MAX_SAMPLES = 10
"""Points along each axis at which a block is sampled; a 1 mm block of 0.1 mm voxels has 10."""

MUSCLE_REACH_MM = 12.0
"""Muscle that reaches further forward than this lies between the plates and must deform, mm."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes of the mechanical lattice, one layer of air around them.

    Parameters
    ----------
    frame : VoxelFrame
        Nodes at rest, compression frame, mm; x index 1 is the chest-wall layer.
    modulus : ndarray of float32, [x, y, z]
        Mean modulus of the tissue in each node's block, kPa; 0 in air.
    muscle : ndarray of bool, [x, y, z]
        Nodes whose tissue is mostly muscle.
    notes : tuple of str
    """

    frame: VoxelFrame
    modulus: NDArray[np.float32]
    muscle: NDArray[np.bool_]
    notes: tuple[str, ...]

    @property
    def tissue(self) -> NDArray[np.bool_]:
        """Nodes that are tissue."""
        return self.modulus > 0.0

    @property
    def height_mm(self) -> tuple[float, float]:
        """Lowest and highest tissue node, compression frame, mm."""
        layers = np.flatnonzero(self.tissue.any(axis=(0, 1)))
        low, high = self.frame.axis_mm(2)[layers[[0, -1]]]
        return float(low), float(high)

    @property
    def front_mm(self) -> float:
        """x of the foremost tissue node, compression frame, mm."""
        layers = np.flatnonzero(self.tissue.any(axis=(1, 2)))
        return float(self.frame.axis_mm(0)[layers[-1]])


@dataclass(frozen=True)
class PosteriorLimits:
    """Breast-frame x of the chest wall's and the muscle's faces, mm."""

    chest_wall_mm: float
    muscle_mm: float


def posterior_limits(breast: BreastPhantom) -> PosteriorLimits:
    """Where the chest wall is (outer face of the first tissue layer) and how far muscle reaches."""
    some = np.flatnonzero(_layer_counts(breast, np.arange(256) > 0))
    if some.size == 0:
        raise InputError(f"{breast.source}: no tissue, every voxel is air")
    face = breast.origin_mm[0] - 0.5 * breast.voxel_mm[0]
    chest_wall = face + some[0] * breast.voxel_mm[0]
    some = np.flatnonzero(_layer_counts(breast, _table(breast, "muscle")))
    muscle = face + (some[-1] + 1) * breast.voxel_mm[0] if some.size else chest_wall
    return PosteriorLimits(float(chest_wall), float(muscle))


def build_lattice(
    breast: BreastPhantom,
    view: View,
    resolution_mm: float,
    moduli: Moduli,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Lattice:
    """Lattice of a phantom in the compression frame of a view.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    resolution_mm : float
        Node spacing, mm.
    moduli : Moduli
        Young's modulus of each tissue.
    shift : tuple of float
        By which part of the spacing the nodes lie off their usual place along y and z.

    Notes
    -----
    Nodes that no chain of neighbours ties to the chest wall have no place of rest and are left out.
    """
    frame = _frame_around(breast, view, resolution_mm, shift)
    fraction, modulus, muscle = gather_tissue(breast, view, frame, moduli)
    tissue = fraction >= SMALLEST_PART
    tissue[[0, -1]] = tissue[:, [0, -1]] = tissue[:, :, [0, -1]] = False
    chest_wall = np.zeros_like(tissue)
    chest_wall[1] = True
    held = tissue & held_together(tissue, chest_wall)
    if not held.any():
        raise InputError(
            f"{breast.source}: no tissue node at the chest wall with compression.resolution_mm "
            f"{resolution_mm}; use a finer resolution"
        )
    apart = int(np.count_nonzero(tissue) - np.count_nonzero(held))
    notes = (
        f"{view.folder}: {apart} lattice nodes are not connected to the chest wall and were "
        f"omitted",
    )
    modulus[~held] = 0.0
    return Lattice(frame, modulus, held & (muscle >= 0.5), notes if apart else ())


def gather_tissue(
    breast: BreastPhantom, view: View, frame: VoxelFrame, value_of: Callable[[str], float]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Tissue in the blocks around the points of a frame (compression frame), each [x, y, z].

    Returns
    -------
    fraction : ndarray of float32
        Part of the block that is tissue.
    mean : ndarray of float32
        Mean of a positive property over that tissue, `value_of` its name; 0 where there is none.
    muscle : ndarray of float32
        Part of that tissue that is muscle.
    """
    fraction, mean, muscle = (np.zeros(frame.shape, np.float32) for _ in range(3))
    fineness = float(frame.spacing_mm[0]) / breast.voxel_mm.min()
    samples = int(np.clip(np.ceil(fineness - 1e-6), 2, MAX_SAMPLES))
    values = np.zeros(256, np.float32)
    for label, name in breast.tissue_of_label.items():
        if name != "air":
            values[label] = value_of(name)
    gather_blocks(
        breast.labels, values, _table(breast, "muscle"), _to_voxel(breast, view, frame), samples,
        fraction, mean, muscle,
    )  # fmt: skip
    return fraction, mean, muscle


def tissue_mean(
    breast: BreastPhantom, view: View, lattice: Lattice, value_of: Callable[[str], float]
) -> NDArray[np.float32]:
    """Mean of a positive property over the tissue in each node's block, [x, y, z]; 0 in air.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    lattice : Lattice
        Of this breast and view.
    value_of : callable
        The property of a tissue, by its name.
    """
    mean = block_mean(breast, view, lattice.frame, value_of)
    mean[~lattice.tissue] = 0.0
    return mean


def block_mean(
    breast: BreastPhantom, view: View, frame: VoxelFrame, value_of: Callable[[str], float]
) -> NDArray[np.float32]:
    """Mean of a positive property over the tissue in each block, [x, y, z]; 0 in air.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    frame : VoxelFrame
        Centres of the blocks, compression frame, mm.
    value_of : callable
        The property of a tissue, by its name.
    """
    return gather_tissue(breast, view, frame, value_of)[1]


def tissue_part(
    breast: BreastPhantom, view: View, frame: VoxelFrame, tissue: str
) -> NDArray[np.float32]:
    """Part of each block around the points of a frame that is one tissue, [x, y, z].

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    frame : VoxelFrame
        Centres of the blocks, compression frame, mm.
    tissue : str
        Its name in the table.
    """
    part, _, _ = gather_tissue(breast, view, frame, lambda name: float(name == tissue))
    return part


def breast_volume_ml(breast: BreastPhantom) -> float:
    """Volume of all tissue but muscle and the abdominal wall below a generated breast's fold.

    Parameters
    ----------
    breast : BreastPhantom
        Uncompressed.

    Returns
    -------
    float
        Voxels that hold tissue times the volume of a voxel, mL. Skin and lesions count; air and
        muscle do not.
    """
    wanted = (np.arange(256) > 0) & ~_table(breast, "muscle")
    count = _layer_counts(breast, wanted).sum() - abdominal_counts(breast)[wanted].sum()
    return float(count * breast.voxel_mm.prod() * 1e-3)


def bounds_mm(breast: BreastPhantom, view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner (3,) of the box around all tissue, compression frame, mm."""
    outline = np.zeros(breast.labels.shape[1:], bool)
    tissue_outline(breast.labels, outline)
    if not outline.any():
        raise InputError(f"{breast.source}: no tissue, every voxel is air")
    rows = np.flatnonzero(outline.any(axis=1))
    lines = outline[rows]
    ends = np.stack([lines.argmax(axis=1), lines.shape[1] - 1 - lines[:, ::-1].argmax(axis=1)])
    extreme = np.stack([np.tile(rows, 2), ends.ravel()], axis=1)  # a turn leaves rows straight
    corners = extreme[:, :, None] + np.array([[-0.5, 0.5]])
    y, z = (
        breast.origin_mm[axis + 1] + corners[:, axis] * breast.voxel_mm[axis + 1]
        for axis in range(2)
    )
    points = np.stack(np.broadcast_arrays(0.0, y[:, :, None], z[:, None, :]), axis=-1)
    rotated = view.compression_from_breast(points.reshape(-1, 3))
    low, high = rotated.min(axis=0), rotated.max(axis=0)
    layers = np.flatnonzero(_layer_counts(breast, np.arange(256) > 0))
    ends = layers[[0, -1]] + np.array([-0.5, 0.5])
    low[0], high[0] = breast.origin_mm[0] + ends * breast.voxel_mm[0]
    return low, high


def _layer_counts(breast: BreastPhantom, wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many voxels of each layer of constant x have one of the wanted labels."""
    counts: NDArray[np.int64] = label_counts(breast)[:, wanted].sum(axis=1)
    return counts


def _frame_around(
    breast: BreastPhantom, view: View, h: float, shift: tuple[float, float]
) -> VoxelFrame:
    """Nodes that cover all tissue: from the chest wall forward, symmetric but for the shift."""
    low, high = bounds_mm(breast, view)
    counts = np.ceil((high - low) / h - 1e-6).astype(int) + 2
    aside = np.array([0.0, *shift])
    counts += 2 * np.ceil(np.abs(aside)).astype(int)
    origin = 0.5 * (low + high) - 0.5 * (counts - 1) * h + aside * h
    origin[0] = low[0] - 0.5 * h
    return VoxelFrame(origin, np.full(3, h), (int(counts[0]), int(counts[1]), int(counts[2])))


def _to_voxel(breast: BreastPhantom, view: View, frame: VoxelFrame) -> NDArray[np.float64]:
    """(3, 4) matrix from lattice indices to fractional voxel indices."""
    turned = view.rotation.T / breast.voxel_mm[:, None]
    shift = turned @ frame.origin_mm - breast.origin_mm / breast.voxel_mm
    return np.column_stack([turned * frame.spacing_mm, shift])


def _table(breast: BreastPhantom, tissue: str) -> NDArray[np.bool_]:
    wanted = np.zeros(256, bool)
    wanted[[label for label, name in breast.tissue_of_label.items() if name == tissue]] = True
    return wanted

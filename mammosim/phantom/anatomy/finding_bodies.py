"""Bodies that findings consist of, and how they become voxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.anatomy._block_kernels import Lattice
from mammosim.tissues import TISSUES

SPREAD = 1.2207440846057596
"""Root of g^4 = g + 1: the multiples of its inverse powers spread evenly in three dimensions, as
those of the golden ratio do in one."""

CALCIFIED = (
    (0.125, "benign_calcification_eighth"),
    (0.25, "benign_calcification_quarter"),
    (0.5, "benign_calcification_half"),
    (1.0, "benign_calcification"),
)
"""Parts of a voxel within the breast that may be calcified, and their tissues."""

Vector = NDArray[np.float64]
Parts = tuple[tuple[float, str], ...]


@dataclass(frozen=True, eq=False)
class Ball:
    """An ellipsoid.

    Parameters
    ----------
    centre_mm : ndarray, (3,)
    axes_mm : ndarray, (3,)
        Half-axes.
    turn : ndarray, (3, 3)
        Rows: directions of the half-axes.
    tissue : str
    into : tuple of str
        Tissues that it replaces; if empty, any but air, skin, nipple and muscle.
    """

    centre_mm: Vector
    axes_mm: Vector
    turn: NDArray[np.float64]
    tissue: str
    into: tuple[str, ...] = ()

    @property
    def reach_mm(self) -> float:
        """Greatest distance of a point of it from its centre, mm."""
        return float(self.axes_mm.max())

    @property
    def parts(self) -> Parts:
        """Parts of a voxel that may be of it, rising, and their tissues."""
        calcified = self.tissue == "benign_calcification" and not self.into
        return CALCIFIED if calcified else ((1.0, self.tissue),)


@dataclass(frozen=True, eq=False)
class Fold:
    """A fold of skin that is pressed together: two layers of skin that reach into the breast.

    Parameters
    ----------
    centre_mm : ndarray, (3,)
        On the skin.
    along, across, inward : ndarray, (3,)
        Unit vectors: of its line on the skin, across it, and into the breast.
    half_length_mm, depth_mm, half_width_mm : float
    """

    centre_mm: Vector
    along: Vector
    across: Vector
    inward: Vector
    half_length_mm: float
    depth_mm: float
    half_width_mm: float

    @property
    def reach_mm(self) -> float:
        """Distance from its centre within which it lies, mm."""
        return float(np.hypot(self.half_length_mm, self.depth_mm))


def paint_findings(
    labels: NDArray[np.uint8],
    lattice: Lattice,
    findings: list[Ball | Fold],
) -> None:
    """Paint findings, so that the mean of partly filled voxels is right.

    A voxel gets the part above or below its own that has a label, and keeps what it holds of others
    if that is more. Which of the two is spread evenly: bodies thinner than a voxel would otherwise
    form stripes.
    """
    axes = (lattice.x_mm, lattice.lateral_mm, lattice.superior_mm)
    voxel = float(axes[0][1] - axes[0][0])
    for one in findings:
        reach = one.reach_mm + voxel
        ends = [np.searchsorted(axis, one.centre_mm[n] + [-reach, reach])
                for n, axis in enumerate(axes)]  # fmt: skip
        box = tuple(slice(int(first), int(last)) for first, last in ends)
        if any(part.start == part.stop for part in box):
            continue
        grid = np.stack(np.meshgrid(*(axis[p] for axis, p in zip(axes, box, strict=True)),
                                    indexing="ij"), axis=-1) - one.centre_mm  # fmt: skip
        part = labels[box]
        if isinstance(one, Ball):
            fill, allowed, parts = _ball_fill(one, grid, voxel), _allowed(one.into, part), one.parts
        else:
            fill, allowed, parts = _fold_fill(one, grid, voxel), part != 0, ((1.0, "skin"),)
        _paint(part, allowed, fill, _even_lots(box), parts)


def _paint(
    labels: NDArray[np.uint8],
    allowed: NDArray[np.bool_],
    fill: NDArray[np.float64],
    lots: NDArray[np.float64],
    parts: Parts,
) -> None:
    """Give each voxel the label of the part above or below its `fill`, by its lot."""
    held, below = np.zeros(256), 0.0
    for share, tissue in parts:
        held[TISSUES[tissue].label] = share
    for share, tissue in parts:
        reached = lots < (fill - below) / (share - below)
        labels[allowed & reached & (held[labels] < share)] = TISSUES[tissue].label
        below = share


def _even_lots(box: tuple[slice, ...]) -> NDArray[np.float64]:
    """A number from 0 to 1 for each voxel of a box, spread evenly over any few neighbours."""
    steps = [SPREAD ** -(axis + 1) * np.arange(p.start, p.stop) for axis, p in enumerate(box)]
    along, across, up = np.ix_(*steps)
    lots: NDArray[np.float64] = (along + across + up) % 1.0
    return lots


def _allowed(into: tuple[str, ...], part: NDArray[np.uint8]) -> NDArray[np.bool_]:
    if into:
        return np.isin(part, [TISSUES[name].label for name in into])
    return ~np.isin(part, [TISSUES[name].label for name in ("air", "skin", "nipple", "muscle")])


def _ball_fill(ball: Ball, grid: NDArray[np.float64], voxel_mm: float) -> NDArray[np.float64]:
    """Part of each voxel that a body fills: to first order, with its volume kept."""
    seen = grid @ ball.turn.T / ball.axes_mm
    radius = np.linalg.norm(seen, axis=-1)
    least = float(ball.axes_mm.min())
    depth_mm = (1.0 - radius) * np.maximum(least, 0.5 * voxel_mm)
    fill = np.clip(depth_mm / voxel_mm + 0.5, 0.0, 1.0)
    wanted = 4.0 / 3.0 * np.pi * float(ball.axes_mm.prod()) / voxel_mm**3
    total = float(fill.sum())
    return fill * min(wanted / total, 1.0) if total > 0.0 else fill


def _fold_fill(fold: Fold, grid: NDArray[np.float64], voxel_mm: float) -> NDArray[np.float64]:
    along, across, inward = (grid @ unit for unit in (fold.along, fold.across, fold.inward))
    place = np.clip(along / fold.half_length_mm, -1.0, 1.0)
    bow = 0.12 * fold.half_length_mm * (place**2 - 0.3)
    depth = fold.depth_mm * (1.0 - place**2)
    beside = np.clip((fold.half_width_mm - np.abs(across - bow)) / voxel_mm + 0.5, 0.0, 1.0)
    fill: NDArray[np.float64] = beside * np.clip((depth - inward) / voxel_mm + 0.5, 0.0, 1.0)
    return fill * (np.abs(along) < fold.half_length_mm)

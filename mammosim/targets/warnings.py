"""Targets of which less is known than their row seems to say, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.plausibility import plausibility_warnings
from mammosim.targets.origins import UncompressedTarget
from mammosim.targets.target import Target


def target_warnings(
    compressed: CompressedBreast,
    targets: Sequence[Target],
    origins: Sequence[UncompressedTarget],
    gantry: Gantry,
) -> tuple[str, ...]:
    """One sentence for each target of a view that left its field or its lattice.

    Parameters
    ----------
    compressed : CompressedBreast
    targets : sequence of Target
        Of this view.
    origins : sequence of UncompressedTarget
        The same targets before compression.
    gantry : Gantry
        Of the view's image.
    """
    notes = []
    for target, origin in zip(targets, origins, strict=True):
        what = f"{compressed.view.folder}: {target.kind} '{target.name}'"
        if target.kind == "nipple":
            what = f"{compressed.view.folder}: the nipple"
        if compressed.is_compressed and not _beside_lattice(compressed, origin):
            notes.append(
                f"{what} is not in the mechanical lattice (its tissue does not reach the chest "
                "wall, or is finer than the lattice); its shift is that of the nearest nodes"
            )
        if target.is_lesion:
            notes += lesion_cut_off(compressed, origin, gantry)
        elif not target.in_field:
            notes.append(f"{what} is not in the image; no needle can be aimed at it")
    return tuple(notes)


def lesion_cut_off(
    compressed: CompressedBreast, origin: UncompressedTarget, gantry: Gantry
) -> tuple[str, ...]:
    """Whether a lesion is only partly, or not at all, in the image of a compressed breast.

    Parameters
    ----------
    compressed : CompressedBreast
    origin : UncompressedTarget
        The lesion before compression.
    gantry : Gantry

    Returns
    -------
    tuple of str
        One sentence with the part that is in the image, or none.
    """
    moved = origin.points_mm + compressed.displacement_at(origin.points_mm)
    row, column = np.moveaxis(gantry.project(gantry.gantry_from_breast(moved)), -1, 0)
    seen = (np.abs(row - 0.5 * (gantry.rows - 1)) <= 0.5 * gantry.rows) & (
        np.abs(column - 0.5 * (gantry.columns - 1)) <= 0.5 * gantry.columns
    )
    what = f"{compressed.view.folder}: {origin.kind} '{origin.name}'"
    found = plausibility_warnings({"lesion_in_image_percent": 100.0 * float(seen.mean())})
    return tuple(f"{what}: {warning}" for warning in found)


def _beside_lattice(compressed: CompressedBreast, origin: UncompressedTarget) -> bool:
    """Whether any of a target's points has a tissue node next to it.

    The tip of a nipple, less than half a node's block, has one behind it that it moves with.
    """
    field = compressed.field
    points = compressed.view.compression_from_breast(origin.points_mm)
    index = np.rint(field.frame.index(points)).astype(np.intp)
    around = index[:, None] + np.indices((3, 3, 3)).reshape(3, -1).T - 1
    around = around.reshape(-1, 3)
    inside = ((around >= 0) & (around < field.frame.shape)).all(axis=1)
    return bool(field.tissue[tuple(around[inside].T)].any())

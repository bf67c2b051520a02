"""Targets of which less is known than their row seems to say, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.targets.origins import Origin
from mammosim.targets.target import Target


def target_doubts(
    squeezed: CompressedBreast, targets: Sequence[Target], origins: Sequence[Origin]
) -> tuple[str, ...]:
    """One sentence for each target of a view that left its field or its lattice.

    Parameters
    ----------
    squeezed : CompressedBreast
    targets : sequence of Target
        Of this view.
    origins : sequence of Origin
        The same targets before compression.
    """
    field, notes = squeezed.field, []
    for target, origin in zip(targets, origins, strict=True):
        what = f"{squeezed.view.folder}: {target.kind} '{target.name}'"
        if target.kind == "nipple":
            what = f"{squeezed.view.folder}: the nipple"
        index = np.rint(field.frame.index(origin.points_mm @ field.rotation.T)).astype(np.intp)
        inside = ((index >= 0) & (index < field.frame.shape)).all(axis=1)
        held = field.tissue[tuple(index[inside].T)]
        if squeezed.model != "none" and not held.any():
            notes.append(
                f"{what} is not in the mechanical lattice (tissue that does not reach the chest "
                "wall, or is finer than the lattice); its shift is that of the nearest nodes"
            )
        if not target.in_field:
            notes.append(f"{what} is not in the picture; no needle can be aimed by it")
    return tuple(notes)

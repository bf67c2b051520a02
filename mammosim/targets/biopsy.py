"""From the mammogram to the needle: where the lesion is then, and by how much it is missed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom, tissue_at
from mammosim.targets.origins import UncompressedTarget, mean_shift_mm, target_origins
from mammosim.targets.target import Target


@dataclass(frozen=True)
class BiopsyResult:
    """One row of `biopsy.csv`: one target of one mammogram, and the needle aimed at it.

    The fields are the table's columns; lengths are in mm, places and `miss_x_mm ...` in the breast
    frame. NaN where no needle can be aimed because the target is not in the picture.
    """

    target_id: int
    name: str
    kind: str
    view: str
    biopsy_view: str
    biopsy_thickness_mm: float
    biopsy_x_mm: float
    biopsy_y_mm: float
    biopsy_z_mm: float
    aim_x_mm: float
    aim_y_mm: float
    aim_z_mm: float
    miss_x_mm: float
    miss_y_mm: float
    miss_z_mm: float
    miss_mm: float
    needle_miss_mm: float
    depth_error_mm: float
    aim_in_breast: bool
    clip_along_mm: float
    clip_across_mm: float
    clip_shift_mm: float
    clip_from_lesion_mm: float


def aim_needles(
    compressed: CompressedBreast,
    targets: Sequence[Target],
    biopsy: CompressedBreast,
    needle: str = "vertical",
) -> list[BiopsyResult]:
    """Aim a needle at each target's mammographic place, in the biopsy position.

    Parameters
    ----------
    compressed : CompressedBreast
        As for the mammogram.
    targets : sequence of Target
        Of that view, as `find_targets` gave them.
    biopsy : CompressedBreast
        The same breast as it is held for the biopsy.
    needle : {"vertical", "lateral"}
        Along the plates' normal from the paddle's side, or across it parallel to the chest wall.

    Returns
    -------
    list of BiopsyResult
        One a target other than the nipple.

    Notes
    -----
    The mammographic place is the vector from the nipple to the lesion in the compressed breast;
    the needle is aimed at the nipple's place in the biopsy position plus that vector (both in the
    breast frame). With u the displacements of the two compressions, the miss is::

        (u_b(lesion) - u_b(nipple)) - (u_m(lesion) - u_m(nipple))

    A clip left at the lesion sits in its tissue: when the plates open, it goes the way back of the
    biopsy's compression. A clip left at the point aimed at goes back with the tissue that was
    there. Not modelled: bending of needle and tissue before the needle, the cavity and the
    bleeding into it, which let real clips slip along the needle's track.
    """
    origins = target_origins(compressed.phantom)
    then = [mean_shift_mm(biopsy.field, origin) for origin in origins]
    nipple_then, nipple_seen = then[-1], targets[-1].shift_vector_mm
    direction = needle_direction(compressed, biopsy, needle)
    rows = []
    for target, origin, shift in zip(targets[:-1], origins[:-1], then[:-1], strict=True):
        miss = miss_mm(target.shift_vector_mm, nipple_seen, shift, nipple_then)
        place = origin.centre_mm + shift
        rows.append(
            BiopsyResult(
                target.target_id, target.name, target.kind, target.view,
                biopsy_name(biopsy), biopsy_thickness_mm(biopsy),
                **_vector("biopsy", place), **_missed(target, place, miss, direction),
                **_clip(target, origin, place, miss, biopsy),
            )
        )  # fmt: skip
    return rows


def miss_mm(
    seen: NDArray[np.float64],
    nipple_seen: NDArray[np.float64],
    then: NDArray[np.float64],
    nipple_then: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(..., 3) from the point aimed at to the lesion at biopsy, breast frame, mm.

    From the displacements of lesion and nipple as seen in the mammogram, and then at biopsy.
    """
    return (then - nipple_then) - (seen - nipple_seen)


def needle_direction(
    compressed: CompressedBreast, biopsy: CompressedBreast, needle: str
) -> NDArray[np.float64]:
    """(3,) unit vector along which the needle goes in, breast frame."""
    held = biopsy if biopsy.is_compressed else compressed
    _, along_wall, normal = held.view.rotation
    return along_wall if needle == "lateral" else -normal


def biopsy_name(biopsy: CompressedBreast) -> str:
    """How the breast is held: the view, the posture, or `none`."""
    return biopsy.view.name if biopsy.is_compressed else biopsy.posture or "none"


def biopsy_thickness_mm(biopsy: CompressedBreast) -> float:
    """Gap between the plates; NaN where there are none."""
    return biopsy.thickness_mm if biopsy.is_compressed else math.nan


def _vector(stem: str, vector: NDArray[np.float64]) -> dict[str, Any]:
    return {f"{stem}_{axis}_mm": float(vector[n]) for n, axis in enumerate("xyz")}


def _missed(
    target: Target,
    place: NDArray[np.float64],
    miss: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> dict[str, Any]:
    """Aim and miss; the needle's own line passes nearer to the lesion than the point aimed at."""
    if not target.in_field:
        place = miss = np.full(3, np.nan)
    depth = float(miss @ direction)
    return {
        **_vector("aim", place - miss),
        **_vector("miss", miss),
        "miss_mm": float(np.linalg.norm(miss)),
        "needle_miss_mm": float(np.linalg.norm(miss - depth * direction)),
        "depth_error_mm": depth,
    }


def _clip(
    target: Target,
    origin: UncompressedTarget,
    place: NDArray[np.float64],
    miss: NDArray[np.float64],
    biopsy: CompressedBreast,
) -> dict[str, Any]:
    """A clip at the lesion when the breast is released, and one left at the point aimed at."""
    released = biopsy.view.compression_from_breast(origin.centre_mm - place)
    row = {
        "aim_in_breast": False,
        "clip_along_mm": float(released[2]),
        "clip_across_mm": float(np.hypot(released[0], released[1])),
        "clip_shift_mm": float(np.linalg.norm(released)),
        "clip_from_lesion_mm": math.nan,
    }
    if not target.in_field:
        return row
    left = biopsy.original_point(place - miss)[0]
    if in_tissue(biopsy.phantom, left):
        row["aim_in_breast"] = True
        row["clip_from_lesion_mm"] = float(np.linalg.norm(left - origin.centre_mm))
    return row


def in_tissue(phantom: BreastPhantom, point_mm: NDArray[np.float64]) -> bool:
    """Whether a point of the uncompressed breast, breast frame, is in tissue; NaN is not."""
    if not np.isfinite(point_mm).all():
        return False
    return tissue_at(phantom, point_mm) not in (None, "air")

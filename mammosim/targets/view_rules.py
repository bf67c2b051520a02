"""How well the rules hold by which radiologists find in one view what they saw in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from mammosim.geometry import Gantry
from mammosim.targets.target import Target


@dataclass(frozen=True)
class RuleError:
    """One row of `view_rules.csv`: one target, from one view to another.

    The fields are the table's columns; lengths are in mm, on the detector unless said otherwise.

    `nipple_distance_mm` is the straight distance in the uncompressed breast, `..._from_mm` and
    `..._to_mm` those on the pictures. The arc rule puts the lesion on the circle about the nipple
    with the first picture's distance; the line rule on the line parallel to the chest wall with
    the first picture's depth behind the nipple. The errors are where it truly is against circle
    and line, positive farther from the nipple.
    """

    target_id: int
    name: str
    kind: str
    from_view: str
    to_view: str
    nipple_distance_mm: float
    nipple_distance_from_mm: float
    nipple_distance_to_mm: float
    arc_error_mm: float
    nipple_depth_from_mm: float
    nipple_depth_to_mm: float
    line_error_mm: float


def rule_errors(
    views: Mapping[str, tuple[Sequence[Target], Gantry]],
) -> list[RuleError]:
    """Predicted against true places, for each target that two views of one breast show.

    Parameters
    ----------
    views : mapping of str to (sequence of Target, Gantry)
        Targets of each view, the nipple last, by the view's name.

    Returns
    -------
    list of RuleError
        Targets that are not in the field of both pictures are left out.

    Notes
    -----
    Distances are not divided by the magnification, as a ruler on the picture does not.
    """
    rows = []
    for one, other in combinations(views, 2):
        (first, gantry), (second, other_gantry) = views[one], views[other]
        theirs = {target.target_id: target for target in second}
        for target in first:
            twin = theirs.get(target.target_id)
            if target.kind == "nipple" or twin is None or not (target.in_field and twin.in_field):
                continue
            depths = (
                _depth_mm(target, first[-1], gantry),
                _depth_mm(twin, second[-1], other_gantry),
            )
            distances = (target.image_nipple_distance_mm, twin.image_nipple_distance_mm)
            rows.append(
                RuleError(
                    target.target_id, target.name, target.kind, one, other,
                    target.nipple_distance_mm,
                    *distances, distances[1] - distances[0], *depths, depths[1] - depths[0],
                )
            )  # fmt: skip
    return rows


def _depth_mm(target: Target, nipple: Target, gantry: Gantry) -> float:
    """Depth behind the nipple, at right angles to the chest-wall edge, on the detector."""
    columns = nipple.image_col_px - target.image_col_px
    if gantry.view.laterality == "R":
        columns = -columns
    return columns * gantry.pixel_mm

"""What is found in healthy breasts: lymph nodes, benign calcifications, moles, folds of the skin.

They are labels like any other tissue, and no lesions: nothing looks for them unless asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.axilla import Axilla, along_mm
from mammosim.phantom.anatomy.finding_bodies import Ball, Fold, Vector
from mammosim.phantom.anatomy.outline import mesh
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.tubes import Tubes, value_at
from mammosim.tissues import TISSUES

AXILLARY_MEAN, INTRAMAMMARY_SHARE = 1.1, 0.06
"""Mean number of lymph nodes in the axilla's part that is imaged, and share of breasts with one
within the breast. Of 102 women with benign biopsies 68 per cent had nodes on axillary views
(Dershaw et al. 1991), which reach a little higher than oblique ones; the mean leaves a third of
breasts without. The share is assumed: nodes within the breast are seen on few views."""

AXILLARY_MM, AXILLARY_LOW = (6.0, 42.0), 0.85
"""Nodes of the axilla lie this far from the open end, mm, and nearer to the chest wall than this
part of the ridge's height: beside the muscle, so that an oblique view shows them over it or near
it. Chosen."""

NODE_MM, NODE_LONG = (2.8, 5.5), (1.2, 2.2)
"""Half the width of a node, mm, and its length against it: nodes of up to about a centimetre in
width are normal. Assumed."""

PLAQUES, FREE_SHARE, PLAQUE_MM, PLAQUE_SPREAD = 3.0, 0.35, 0.35, 0.6
"""Mean number of plaques per piece of a calcified artery, share of pieces without any, and half a
plaque's length: median, mm, and spread of its logarithm. Chosen by eye: tracks are broken, and
their plaques are of unequal size."""

VASCULAR_SHARE, OTHER_SHARE = 0.079, 0.15
"""Share of breasts with calcified arteries, of 6156 consecutive women (7.9 per cent:
PubMed 16890393, "Mammographically detected breast arterial calcifications"), and with other benign
calcifications (assumed)."""


@dataclass(frozen=True, eq=False)
class Site:
    """The breast that findings are placed in: coarse fields, their grid, axilla and arteries."""

    skin_depth_mm: NDArray[np.float64]
    muscle_depth_mm: NDArray[np.float64]
    skin_mm: NDArray[np.float64]
    frame: VoxelFrame
    axilla: Axilla
    nipple_mm: Vector
    tubes: Tubes

    def inward(self, place: Vector) -> Vector:
        """Direction into the breast at a place."""
        step = np.eye(3) * float(self.frame.spacing_mm[0])
        slope = np.array(
            [
                value_at(self.skin_depth_mm, self.frame, place + s)
                - value_at(self.skin_depth_mm, self.frame, place - s)
                for s in step
            ]
        )
        return _unit(slope)

    def place(self, where: NDArray[np.bool_], rng: np.random.Generator) -> Vector | None:
        """A random point of a region, mm; none if it is empty."""
        cells = np.argwhere(where)
        if not len(cells):
            return None
        cell = cells[rng.integers(len(cells))] + rng.uniform(-0.5, 0.5, 3)
        point: Vector = self.frame.position_mm(cell[None])[0]
        return point


def draw_findings(
    settings: GenerateSettings, site: Site, rng: np.random.Generator
) -> list[Ball | Fold]:
    """Findings of a breast, in the order in which they are painted."""
    found: list[Ball | Fold] = []
    found += _nodes(settings.lymph_nodes, site, rng)
    found += _calcifications(settings.benign_calcifications, site, rng)
    for _ in range(settings.skin_folds):
        found += _fold(site, rng)
    for _ in range(settings.moles):
        found += _mole(site, rng)
    return found


def _unit(vector: Vector) -> Vector:
    unit: Vector = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return unit


def _directions(first: Vector, other: Vector) -> NDArray[np.float64]:
    """Rows: a unit vector, one at right angles to it and to another vector, and their product."""
    second = _unit(np.cross(first, other))
    return np.stack([first, second, np.cross(first, second)])


def _turn(rng: np.random.Generator) -> NDArray[np.float64]:
    """Random directions at right angles to each other, as rows."""
    turned, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rows: NDArray[np.float64] = turned
    return rows


def _nodes(number: int | None, site: Site, rng: np.random.Generator) -> list[Ball | Fold]:
    """Lymph nodes: in the axilla, and rarely in the upper outer quadrant of the breast."""
    x, lateral, superior = mesh(site.frame)
    along = along_mm(lateral, superior)
    soft = site.muscle_depth_mm < -4.0
    cut = site.axilla.cut_mm
    near, far = AXILLARY_MM
    axilla = soft & (site.skin_depth_mm > 8.0) & (along > cut - far) & (along < cut - near)
    axilla &= x < AXILLARY_LOW * site.axilla.height_mm
    outer = soft & (site.skin_depth_mm > 7.0) & (site.skin_depth_mm < 25.0)
    outer &= (along > 0.35 * cut) & (along < cut - 50.0)
    wanted = [axilla] * int(rng.poisson(AXILLARY_MEAN) if number is None else number)
    if number is None and rng.random() < INTRAMAMMARY_SHARE:
        wanted.append(outer)
    found: list[Ball | Fold] = []
    for where in wanted:
        centre = site.place(where, rng)
        if centre is not None:
            found += _node(centre, rng.uniform(*NODE_MM) * (1.0 if where is axilla else 0.6), rng)
    return found


def _node(centre: Vector, half_width_mm: float, rng: np.random.Generator) -> list[Ball | Fold]:
    """A bean of lymphoid tissue with a hilum of fat on one side."""
    turn = _turn(rng)
    axes = half_width_mm * np.array([rng.uniform(*NODE_LONG), 1.0, rng.uniform(0.8, 1.1)])
    hilum = centre + rng.uniform(0.4, 0.9) * axes[1] * turn[1]
    share = np.array([0.65, 0.65, 0.6]) * rng.uniform(0.5, 1.0)
    return [
        Ball(centre, axes, turn, "lymph_node"),
        Ball(hilum, share * axes, turn, "adipose", ("lymph_node",)),
    ]


def _calcifications(kind: str, site: Site, rng: np.random.Generator) -> list[Ball | Fold]:
    """Benign calcifications of a kind, or by chance."""
    kinds = {"vascular": _vascular, "round": _round, "popcorn": _popcorn, "rods": _rods,
             "skin": _in_skin}  # fmt: skip
    wanted = [kind] if kind in kinds else []
    if kind == "chance":
        lots = rng.random(2)
        wanted = ["vascular"] if lots[0] < VASCULAR_SHARE else []
        if lots[1] < OTHER_SHARE:
            others = ("round", "round", "skin", "popcorn", "rods")
            wanted.append(others[int(rng.integers(len(others)))])
    return [body for name in wanted for body in kinds[name](site, rng)]


def _calcified(centre: Vector, axes_mm: Vector, turn: NDArray[np.float64]) -> Ball:
    return Ball(centre, axes_mm, turn, "benign_calcification")


def _inside(site: Site, depth_mm: float) -> NDArray[np.bool_]:
    x, _, _ = mesh(site.frame)
    found: NDArray[np.bool_] = (
        (site.skin_depth_mm > depth_mm) & (site.muscle_depth_mm < -3.0) & (x > 8.0)
    )
    return found


def _vascular(site: Site, rng: np.random.Generator) -> list[Ball]:
    """Plaques in the wall of arteries: two broken lines along a stretch of each."""
    artery = np.flatnonzero(site.tubes.label == TISSUES["artery"].label)
    if not artery.size:
        return []
    first = int(rng.integers(artery.size))
    stretch = artery[first : first + int(rng.integers(12, 32))]
    found = []
    for piece in stretch:
        (start, end), radius = site.tubes.ends_mm[piece], float(site.tubes.radius_mm[piece].mean())
        ahead = _unit(end - start)
        plaques = rng.poisson(PLAQUES) if rng.random() > FREE_SHARE else 0
        for _ in range(int(plaques)):
            turn = _directions(ahead, rng.standard_normal(3))
            half = min(PLAQUE_MM * float(np.exp(PLAQUE_SPREAD * rng.standard_normal())), 1.5)
            # a shell of the wall: dense where it is seen along its surface, at both sides
            size = np.array([half, rng.uniform(0.06, 0.12), radius * rng.uniform(0.3, 0.9)])
            at = start + rng.random() * (end - start) + radius * turn[1]
            found.append(_calcified(at, size, turn))
    return found


def _round(site: Site, rng: np.random.Generator) -> list[Ball]:
    """Single smooth round calcifications of half a millimetre to a little over one."""
    found, inside = [], _inside(site, 4.0)
    for _ in range(int(rng.integers(1, 6))):
        at = site.place(inside, rng)
        if at is not None:
            radius = rng.uniform(0.2, 0.6) * rng.uniform(0.9, 1.1, 3)
            found.append(_calcified(at, radius, _turn(rng)))
    return found


def _popcorn(site: Site, rng: np.random.Generator) -> list[Ball]:
    """Coarse lumps of an old fibroadenoma."""
    middle = site.place(_inside(site, 12.0), rng)
    if middle is None:
        return []
    spread = rng.uniform(1.5, 3.0)
    return [
        _calcified(
            middle + spread * rng.standard_normal(3).clip(-1.5, 1.5),
            rng.uniform(0.4, 1.3) * rng.uniform(0.7, 1.2, 3),
            _turn(rng),
        )
        for _ in range(int(rng.integers(6, 16)))
    ]


def _rods(site: Site, rng: np.random.Generator) -> list[Ball]:
    """Secretory rods in ducts, which point to the nipple."""
    found, inside = [], _inside(site, 10.0)
    for _ in range(int(rng.integers(4, 14))):
        at = site.place(inside, rng)
        if at is not None:
            ahead = _unit(site.nipple_mm - at + 6.0 * rng.standard_normal(3))
            axes = np.array([rng.uniform(1.0, 4.0), 0.25, 0.25]) * [1.0, *rng.uniform(0.8, 1.4, 2)]
            found.append(_calcified(at, axes, _directions(ahead, np.array([0.0, 0.6, 0.8]))))
    return found


def _in_skin(site: Site, rng: np.random.Generator) -> list[Ball]:
    """Calcified glands of the skin, with a lucent centre."""
    found = []
    for _ in range(int(rng.integers(1, 5))):
        at = _on_skin(site, rng)
        if at is None:
            continue
        centre = at + 0.5 * value_at(site.skin_mm, site.frame, at) * site.inward(at)
        radius, turn = rng.uniform(0.4, 0.7), _turn(rng)
        found.append(Ball(centre, np.full(3, radius), turn, "benign_calcification", ("skin",)))
        found.append(
            Ball(centre, np.full(3, 0.5 * radius), turn, "skin", ("benign_calcification",))
        )
    return found


def _on_skin(
    site: Site, rng: np.random.Generator, where: NDArray[np.bool_] | None = None
) -> Vector | None:
    """A point on the skin's outer face, away from the chest wall and the nipple."""
    x, lateral, superior = mesh(site.frame)
    near = (np.abs(site.skin_depth_mm) < 1.5) & (x > 12.0)
    near = near & (np.hypot(lateral, superior) > 22.0)
    near = near & (along_mm(lateral, superior) < site.axilla.cut_mm - 8.0)
    at = site.place(near if where is None else near & where, rng)
    if at is None:
        return None
    for _ in range(3):
        at = at - value_at(site.skin_depth_mm, site.frame, at) * site.inward(at)
    return at


def _mole(site: Site, rng: np.random.Generator) -> list[Ball | Fold]:
    """A raised mole: a flat dome of skin, 3 to 7 mm wide, with air around it."""
    at = _on_skin(site, rng)
    if at is None:
        return []
    turn = _directions(site.inward(at), rng.standard_normal(3))
    axes = np.array([rng.uniform(1.0, 2.2), *rng.uniform(1.5, 3.5, 2)])
    return [Ball(at, axes, turn, "skin", ("air",))]


def _fold(site: Site, rng: np.random.Generator) -> list[Ball | Fold]:
    """A fold in the hollow between breast and axilla, across the way to the arm."""
    _, lateral, superior = mesh(site.frame)
    along = along_mm(lateral, superior)
    cut = site.axilla.cut_mm
    at = _on_skin(site, rng, (along > cut - 50.0) & (along < cut - 12.0))
    if at is None:
        return []
    way = np.array([0.0, 1.0, 1.0]) + 0.4 * rng.standard_normal(3)
    inward, line, across = _directions(site.inward(at), way)
    return [
        Fold(at, line, across, inward, rng.uniform(14.0, 30.0),
             rng.uniform(3.0, 8.0), value_at(site.skin_mm, site.frame, at))
    ]  # fmt: skip

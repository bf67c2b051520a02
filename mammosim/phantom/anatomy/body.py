"""What a seed decides of a breast from outside: size, shape, muscle, nipple; and its lattice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._block_kernels import Lattice, Paint
from mammosim.phantom.anatomy.axilla import CUT_DEG, draw_axilla
from mammosim.phantom.anatomy.fold import draw_fold
from mammosim.phantom.anatomy.muscle import (
    COVER_MM,
    STANDING,
    Muscle,
    draw_muscle,
    fit_volume,
    muscle_depths,
)
from mammosim.phantom.anatomy.nipple import Areola, Nipple, draw_areola, draw_nipple, varied
from mammosim.phantom.anatomy.outline import (
    GRID_MM,
    Outline,
    coarse_frame,
    depth_of_breast,
    held_depth,
    mesh,
    skin_depth,
    surfaces_of,
)
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.shape import TYPICAL_ML, draw_shape, like
from mammosim.phantom.anatomy.skin import SKIN_MEAN_MM, SKIN_RANGE_MM
from mammosim.phantom.breast import BreastPhantom, OpenEnd
from mammosim.phantom.orientation import nipple_position
from mammosim.tissues import TISSUES

VOLUME_SPREAD, VOLUMES_ML = 0.48, (100.0, 1900.0)
"""Spread of the logarithm of volumes drawn, about `TYPICAL_ML`, and their bounds, mL. Chosen so
that thickness and area of compressed breasts are spread as published (docs/explanation/phantom.md
compares them)."""

SIDES_SPREAD = 0.04
"""The same of each breast about what a woman's have in common: two thirds of pairs differ by less
than 6 %."""


@dataclass(frozen=True, eq=False)
class Body:
    """A breast from outside: depths are on the grid of `frame`, positive inside, mm.

    `own_mm` is the depth in the breast itself, without the abdominal wall below its fold;
    `held_mm` that near the skin in views without the axilla; `behind_mm` that behind the muscle's
    front, in muscle or the fat beside it.
    """

    outline: Outline
    frame: VoxelFrame
    depth_mm: NDArray[np.float64]
    own_mm: NDArray[np.float64]
    held_mm: NDArray[np.float32]
    behind_mm: NDArray[np.float64]
    muscle_mm: NDArray[np.float64]
    muscle: Muscle
    skin_mm: float
    nipple: Nipple
    areola: Areola


def expected_volume_ml(settings: GenerateSettings, seed: int, laterality: str = "L") -> float:
    """Volume of the breast that a seed will give, without making it.

    Parameters
    ----------
    settings : GenerateSettings
    seed : int
    laterality : {"L", "R"}
        The two breasts of a seed belong to one woman, and differ a little.

    Returns
    -------
    float
        Without the pectoral muscle, mL.
    """
    return _volume_ml(settings, streams_of_woman(seed)[0], streams_of_breast(seed, laterality)[0])


def streams_of_woman(seed: int) -> list[np.random.Generator]:
    """Streams of what both breasts of a woman share: of shape and of how gland lies."""
    return np.random.default_rng(seed).spawn(2)


def streams_of_breast(seed: int, laterality: str) -> list[np.random.Generator]:
    """Streams of one breast's own: size, shape, fields, lobules, ducts, vessels, threads and
    findings."""
    return np.random.default_rng([seed, "LR".index(laterality) + 1]).spawn(8)


def _volume_ml(
    settings: GenerateSettings, shared: np.random.Generator, own: np.random.Generator
) -> float:
    drawn = np.exp(VOLUME_SPREAD * shared.standard_normal())
    sides = np.exp(SIDES_SPREAD * np.clip(own.standard_normal(), -2.0, 2.0))
    return settings.volume_ml or float(np.clip(TYPICAL_ML * drawn * sides, *VOLUMES_ML))


def draw_body(settings: GenerateSettings, seed: int, laterality: str) -> Body:
    """The body of a seed's breast."""
    shared, _ = streams_of_woman(seed)
    size_rng, shape_rng = streams_of_breast(seed, laterality)[:2]
    volume_ml = _volume_ml(settings, shared, size_rng)
    skin = float(np.clip(shared.normal(*SKIN_MEAN_MM), *SKIN_RANGE_MM))
    nipple = varied(draw_nipple(settings, shared), settings, shape_rng)
    shape = like(draw_shape(volume_ml, shared), shape_rng)
    axilla, muscle = draw_axilla(shape, shared), draw_muscle(shared)
    areola = draw_areola(shared)
    fold = draw_fold(shape, shared)
    outline = fit_volume(Outline(shape, axilla, fold), muscle, volume_ml - areola.bulge_ml)
    frame = coarse_frame(outline)
    surfaces = surfaces_of(outline, frame)
    bulge = areola.bulge_mm(*mesh(frame)[1:])
    depth = skin_depth(surfaces) + bulge
    return Body(
        outline,
        frame,
        depth,
        depth_of_breast(surfaces, depth),
        (held_depth(outline, surfaces, frame) + bulge).astype(np.float32),
        *muscle_depths(muscle, outline, frame),
        muscle,
        settings.skin_mm or skin,
        nipple,
        areola,
    )


def lattice_of(body: Body, voxel_mm: float) -> Lattice:
    """Voxel centres from the chest wall to a voxel or two of air around breast and nipple."""
    origin = body.frame.origin_mm
    shape = body.outline.shape
    front = max(shape.front_mm, shape.depth_mm + body.nipple.height_mm)
    front += body.areola.raised_mm + 2.0 * voxel_mm
    (low_lateral, high_lateral), (low_superior, high_superior) = _sides_mm(body)
    low = np.array([0.0, low_lateral, low_superior])
    high = np.array([front, high_lateral, high_superior])
    count = np.ceil((high + voxel_mm) / voxel_mm).astype(int)
    first = np.floor((low - voxel_mm) / voxel_mm).astype(int)
    axes = [
        (np.arange(start, end) + 0.5) * voxel_mm
        for start, end in zip((0, first[1], first[2]), count, strict=True)
    ]
    starts = [
        np.searchsorted(axis, origin[n] + GRID_MM * np.arange(body.frame.shape[n]))
        for n, axis in enumerate(axes)
    ]
    x, lateral, superior = axes
    x_start, lateral_start, superior_start = starts
    return Lattice(x, lateral, superior, origin, GRID_MM, x_start, lateral_start, superior_start)


def _sides_mm(body: Body) -> tuple[tuple[float, float], tuple[float, float]]:
    """Where tissue begins and ends along lateral and superior, in front of the wall, mm.

    Only up to the open end: the grid goes on beyond it, and spreads behind the wall.
    """
    x, lateral, superior = (body.frame.axis_mm(axis) for axis in range(3))
    cut_lateral, cut_superior, cut_mm = _cut(body.outline)
    depth = body.depth_mm[x >= 0.0]
    # The cut as the blocks on both sides of a column meet it.
    last_lateral = (cut_mm - cut_superior * (superior - GRID_MM)) / cut_lateral
    last_superior = (cut_mm - cut_lateral * (lateral - GRID_MM)) / cut_superior
    return (
        _ends_mm(depth.swapaxes(1, 2), lateral, last_lateral[:, None]),
        _ends_mm(depth, superior, last_superior[:, None]),
    )


def _ends_mm(
    depth_mm: NDArray[np.float64], places_mm: NDArray[np.float64], last_mm: NDArray[np.float64]
) -> tuple[float, float]:
    """Lowest and highest place where a depth, linear along the last axis, is positive, mm.

    Each column counts up to its own last place. Between columns that a trilinear depth joins it is
    positive nowhere beyond.
    """
    before, after, start = depth_mm[..., :-1], depth_mm[..., 1:], places_mm[:-1]
    turns = (before > 0.0) != (after > 0.0)
    part = np.divide(before, before - after, out=np.ones_like(before), where=turns)
    place = start + GRID_MM * part
    low = place[turns & (after > 0.0) & (place < last_mm)].min()
    high = np.minimum(place, last_mm)[(before > 0.0) & (start < last_mm)].max()
    return float(low), float(high)


def _cut(outline: Outline) -> NDArray[np.float64]:
    """Direction out of the open end (lateral, superior) and its distance from the x axis, mm."""
    angle = np.deg2rad(CUT_DEG)
    return np.array([np.cos(angle), np.sin(angle), outline.axilla.cut_mm])


def paint_of(body: Body) -> Paint:
    """Labels and lengths of the last step; the threshold of gland is not known yet."""
    names = (
        "adipose", "skin", "gland", "nipple", "muscle", "ligament", "ligament_eighth",
        "ligament_quarter", "ligament_half",
    )  # fmt: skip
    areola, shape = body.areola, body.outline.shape
    return Paint(
        body.nipple.numbers(shape.depth_mm + areola.raised_mm, shape.facing, areola.root_mm),
        np.array([areola.thicker_mm + areola.raised_mm, areola.radius_mm]),
        _cut(body.outline), COVER_MM, 0.0,
        np.array([TISSUES[name].label for name in names], np.uint8),
    )  # fmt: skip


def phantom_of(
    labels: NDArray[np.uint8],
    lattice: Lattice,
    body: Body,
    settings: GenerateSettings,
    seed: int,
    laterality: str,
    end: OpenEnd,
) -> BreastPhantom:
    """Labels with what else is known of the breast; a right one is mirrored."""
    first_y = lattice.lateral_mm[0]
    if laterality == "R":
        for layer in labels:
            layer[:] = layer[::-1].copy()
        first_y = -lattice.lateral_mm[-1]
    nx, ny, nz = labels.shape
    frame = VoxelFrame(
        np.array([lattice.x_mm[0], first_y, lattice.superior_mm[0]]),
        np.full(3, settings.voxel_mm),
        (nx, ny, nz),
    )
    return BreastPhantom(
        labels,
        frame.spacing_mm,
        frame.origin_mm,
        laterality,
        {tissue.label: tissue.name for tissue in TISSUES.values()},
        nipple_position(labels, frame)[0],
        open_end=end,
        source=f"generated ({settings.density_class}, seed {seed})",
    )


def open_end_of(body: Body, laterality: str, skin_mm: float) -> OpenEnd:
    """The cut towards the axilla, and the skin of views that hold no axilla."""
    side = 1.0 if laterality == "L" else -1.0
    angle = np.deg2rad(CUT_DEG)
    out = np.array([0.0, side * np.cos(angle), np.sin(angle)])
    frame, outline = body.frame, body.outline
    depth = body.held_mm
    origin = frame.origin_mm.copy()
    if laterality == "R":
        depth = np.ascontiguousarray(depth[:, ::-1])
        origin[1] = -(origin[1] + frame.spacing_mm[1] * (frame.shape[1] - 1))
    held_frame = VoxelFrame(origin, frame.spacing_mm, frame.shape)
    return OpenEnd(outline.axilla.cut_mm * out, out, depth, held_frame, skin_mm, STANDING)

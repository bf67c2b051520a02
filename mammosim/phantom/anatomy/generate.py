"""A breast from a seed: shape, muscle, ducts and lobes, fat lobules, ligaments, vessels, skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.config import documents_keys, given_settings
from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy import _kernels
from mammosim.phantom.anatomy._tube_kernels import paint_tubes
from mammosim.phantom.anatomy.axilla import CUT_DEG, OFF_DEG, Axilla, draw_axilla
from mammosim.phantom.anatomy.ducts import grow_ducts
from mammosim.phantom.anatomy.keys import OtherGenerateKeys
from mammosim.phantom.anatomy.muscle import (
    COVER_MM,
    FIBRE_NOISE,
    draw_muscle,
    fit_volume,
    muscle_depth,
)
from mammosim.phantom.anatomy.outline import GRID_MM, Outline, coarse_frame, skin_depth
from mammosim.phantom.anatomy.parenchyma import (
    Parenchyma,
    draw_parenchyma,
    gland_potential,
    gland_room,
    septum_mm,
    warps,
)
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.shape import TYPICAL_ML, draw_shape
from mammosim.phantom.anatomy.tubes import Tubes, gather_tubes
from mammosim.phantom.anatomy.vessels import grow_vessels
from mammosim.phantom.breast import BreastPhantom, OpenEnd
from mammosim.phantom.orientation import nipple_position
from mammosim.tissues import TISSUES

VOLUME_SPREAD, VOLUMES_ML = 0.48, (100.0, 1900.0)
"""Spread of the logarithm of volumes drawn, about `TYPICAL_ML`, and their bounds, mL. Chosen so
that thickness and area of compressed breasts are spread as published (docs/explanation/phantom.md
compares them)."""

LOBULE_MM = 11.0
"""Side of the cells that hold one fat lobule each, mm: lobules are 5 to 20 mm across."""

FAN_SHARE, FAN_PER_RADIAN = (0.40, 0.36, 0.38, 0.40), (5.0, 11.0, 23.0, 46.0)
"""Strands: relative amplitude, and waves per radian seen from behind the nipple."""

GRAIN_AMPLITUDE, GRAIN_MM = (0.12, 0.28, 0.52), (6.5, 3.1, 1.4)
"""Isotropic detail. Equal amplitude an octave would be a volume spectrum f^-3, whose exponent a
parallel projection keeps; the threshold smooths, so that finer octaves are made stronger until
projections have the exponent of mammograms, 2.8 on average and 1.5 to 3.5 over breasts (Burgess
1999, Proc SPIE 3659)."""

AREOLA_MM = (0.5, 14.0)
"""Extra thickness of the skin at the areola and its radius, mm: skin is thickest there; the
numbers are a choice."""

SAMPLE_MM = 1.5
"""Distance of the voxels on which the share of gland is set, mm."""


Density = Literal["fatty", "scattered", "heterogeneous", "dense", "a", "b", "c", "d"]


@documents_keys(GenerateSettings, OtherGenerateKeys)
def generate_phantom(
    density: Density | GenerateSettings = "scattered",
    voxel_mm: float | None = None,
    seed: int = 1,
    laterality: Literal["L", "R"] = "L",
    **keys: Unpack[OtherGenerateKeys],
) -> BreastPhantom:
    """Make a breast.

    Parameters
    ----------
    density : {"fatty", "scattered", "heterogeneous", "dense", "a", "b", "c", "d"} or \
GenerateSettings
        Density class; or all settings as one object.
    voxel_mm : float, optional
        Voxel size, mm, default 0.5. The anatomy is the same at every size.
    seed : int
        Seed, 0 or more: the same seed gives the same voxels whatever the number of threads.
    laterality : {"L", "R"}
        A right breast is the mirror image of the left one of its seed.
    **keys
        Other keys of `GenerateSettings`.

    Returns
    -------
    BreastPhantom
        The chest-wall plane is x = 0, the nipple's foot lies on the x axis. Towards the axilla
        the voxels end in an open plane without skin (`open_end`).

    Raises
    ------
    InputError
        If a setting is not known or not allowed.

    Notes
    -----
    Smooth fields (distance to skin, muscle and ducts, where gland may be) are made on a grid of
    2 mm; gland is where their sum with noise, strands towards the nipple and fat lobules exceeds
    a threshold, which is set so that the class's share of fibroglandular tissue (gland, ducts,
    units, ligaments and vessels, of all within the skin but muscle) is met. Surfaces of skin are
    dithered within a voxel, so that their staircase draws no contour lines. The breast is at rest
    without gravity. Ribs, lymph nodes and Montgomery's glands are not modelled.
    """
    if laterality not in ("L", "R"):
        raise InputError(f"laterality: found '{laterality}', expected L or R")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: found {seed!r}, expected a whole number of 0 or more")
    given: dict[str, Any] = dict(keys)
    if voxel_mm is not None:
        given["voxel_mm"] = voxel_mm
    if not isinstance(density, GenerateSettings):
        given["density"] = density
    settings = density if isinstance(density, GenerateSettings) else None
    settings = given_settings(GenerateSettings, settings, given, "generate_phantom")
    return _generate(settings, int(seed), laterality)


@dataclass(frozen=True, eq=False)
class _Anatomy:
    """What a seed decides before any voxel is made: outline, coarse fields, tubes, skin."""

    outline: Outline
    frame: VoxelFrame
    kind: Parenchyma
    fields: NDArray[np.float32]
    tubes: Tubes
    skin_mm: float
    nipple_mm: tuple[float, float]


def _generate(settings: GenerateSettings, seed: int, laterality: str) -> BreastPhantom:
    shape_rng, field_rng, lobule_rng, duct_rng, vessel_rng = _streams(seed)
    anatomy = _anatomy(settings, shape_rng, field_rng, duct_rng, vessel_rng)
    lattice = _lattice(anatomy, settings.voxel_mm)
    texture = _texture(anatomy, seed, lobule_rng)
    labels = np.zeros(
        (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size), np.uint8
    )
    tubes = anatomy.tubes
    paint_tubes(labels, lattice, tubes.ends_mm, tubes.radius_mm, tubes.label)
    paint = _paint(anatomy)
    paint = paint._replace(
        threshold=_threshold(labels, lattice, texture, paint, settings.target_percent)
    )
    _kernels.paint_tissue(labels, lattice, texture, paint)
    return _phantom(labels, lattice, anatomy, settings, seed, laterality)


def expected_volume_ml(settings: GenerateSettings, seed: int) -> float:
    """Volume of the breast without muscle that a seed will give, mL, without making it."""
    return _volume_ml(settings, _streams(seed)[0])


def _streams(seed: int) -> list[np.random.Generator]:
    """Of shape, fields, lobules, ducts and vessels, so that none depends on another's draws."""
    return np.random.default_rng(seed).spawn(5)


def _volume_ml(settings: GenerateSettings, shape_rng: np.random.Generator) -> float:
    drawn_ml = TYPICAL_ML * np.exp(VOLUME_SPREAD * shape_rng.standard_normal())
    return settings.volume_ml or float(np.clip(drawn_ml, *VOLUMES_ML))


def _anatomy(
    settings: GenerateSettings,
    shape_rng: np.random.Generator,
    field_rng: np.random.Generator,
    duct_rng: np.random.Generator,
    vessel_rng: np.random.Generator,
) -> _Anatomy:
    volume_ml = _volume_ml(settings, shape_rng)
    skin = float(np.clip(shape_rng.normal(1.45, 0.18), 1.2, 2.0))
    height, width = shape_rng.uniform(4.0, 9.0), shape_rng.uniform(8.0, 12.0)
    nipple = (settings.nipple_height_mm or height, settings.nipple_diameter_mm or width)
    shape = draw_shape(volume_ml, shape_rng)
    axilla, muscle = draw_axilla(shape, shape_rng), draw_muscle(shape_rng)
    outline = fit_volume(Outline(shape, axilla), muscle, volume_ml)
    frame = coarse_frame(outline)
    depth, muscled = skin_depth(outline, frame), muscle_depth(muscle, outline, frame)
    kind = draw_parenchyma(settings.density_class, field_rng)
    room = gland_room(outline, kind, depth, muscled, frame, field_rng)
    ends = np.array([outline.shape.depth_mm, outline.shape.depth_mm + nipple[0]])
    trees = grow_ducts(room, frame, ends, kind.units_a_lobe, duct_rng)
    gland = gland_potential(room, trees, kind, frame, field_rng)
    channels = [depth, muscled, gland, *warps(frame, field_rng), septum_mm(depth, frame, field_rng)]
    fields = np.stack(np.broadcast_arrays(*channels), axis=-1).astype(np.float32)
    vessels = grow_vessels(outline, depth, muscled, frame, vessel_rng)
    tubes = gather_tubes([*vessels, *trees.pieces])
    return _Anatomy(outline, frame, kind, fields, tubes, settings.skin_mm or skin, nipple)


def _lattice(anatomy: _Anatomy, voxel_mm: float) -> _kernels.Lattice:
    """Voxel centres from the chest wall to two voxels of air around breast and nipple."""
    depth, origin = anatomy.fields[..., _kernels.SKIN_DEPTH], anatomy.frame.origin_mm
    inside = np.argwhere(depth > 0)
    at = origin[1:] + inside[:, 1:] * GRID_MM
    cut = _cut(anatomy.outline)
    inside = inside[at @ cut[:2] < cut[2] + GRID_MM]
    low = origin + (inside.min(axis=0) - 1) * GRID_MM
    high = origin + (inside.max(axis=0) + 1) * GRID_MM
    front = anatomy.outline.shape.depth_mm + anatomy.nipple_mm[0] + 2.0 * voxel_mm
    count = np.ceil((np.array([front, *high[1:]]) + voxel_mm) / voxel_mm).astype(int)
    first = np.floor((low - voxel_mm) / voxel_mm).astype(int)
    return _kernels.Lattice(
        (np.arange(count[0]) + 0.5) * voxel_mm,
        (np.arange(first[1], count[1]) + 0.5) * voxel_mm,
        (np.arange(first[2], count[2]) + 0.5) * voxel_mm,
        origin,
        GRID_MM,
    )


def _texture(anatomy: _Anatomy, seed: int, rng: np.random.Generator) -> _kernels.Texture:
    fields, kind, origin = anatomy.fields, anatomy.kind, anatomy.frame.origin_mm
    extent = np.array(fields.shape[:3]) * GRID_MM
    cells = np.ceil(extent / LOBULE_MM).astype(int) + 2
    seeds = np.empty((*cells, 4), np.float32)
    seeds[..., :3] = rng.uniform(0.12, 0.88, (*cells, 3))
    seeds[..., 3] = rng.gamma(2.0, 0.9, tuple(cells))
    return _kernels.Texture(
        fields, seeds, origin - LOBULE_MM, LOBULE_MM,
        np.array([anatomy.outline.shape.depth_mm + 5.0, 0.0, 0.0]),
        kind.strands * np.array(FAN_SHARE), np.array(FAN_PER_RADIAN),
        np.array(GRAIN_AMPLITUDE), np.array(GRAIN_MM), kind.lobules, seed & 0xFFFFFF,
    )  # fmt: skip


def _cut(outline: Outline) -> NDArray[np.float64]:
    """Direction out of the open end (lateral, superior) and its distance from the x axis, mm."""
    angle = np.deg2rad(CUT_DEG)
    return np.array([np.cos(angle), np.sin(angle), outline.axilla.cut_mm])


def _paint(anatomy: _Anatomy) -> _kernels.Paint:
    height, diameter = anatomy.nipple_mm
    names = ("adipose", "skin", "gland", "nipple", "muscle", "ligament")
    return _kernels.Paint(
        anatomy.skin_mm, np.array([anatomy.outline.shape.depth_mm, height, 0.5 * diameter]),
        np.array(AREOLA_MM), _cut(anatomy.outline), COVER_MM, FIBRE_NOISE, 0.0,
        np.array([TISSUES[name].label for name in names], np.uint8),
    )  # fmt: skip


def _threshold(
    labels: NDArray[np.uint8],
    lattice: _kernels.Lattice,
    texture: _kernels.Texture,
    paint: _kernels.Paint,
    percent: float,
) -> float:
    """Potential above which tissue is gland, so that the fibroglandular share is met."""
    voxel = float(lattice.x_mm[1] - lattice.x_mm[0])
    stride = max(1, round(SAMPLE_MM / voxel))
    shape = tuple((side + stride - 1) // stride for side in labels.shape)
    potential, state = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
    _kernels.sample_potential(labels, lattice, texture, paint, stride, potential, state)
    tissue = state != _kernels.NOT_COUNTED
    wanted = percent / 100.0 * tissue.sum()
    always = np.count_nonzero(state == _kernels.TUBE)
    plain, walls = (
        np.sort(potential[state == _kernels.FAT_OR_GLAND]),
        np.count_nonzero(state == _kernels.WALL_OR_GLAND),
    )
    # Walls count whatever the threshold; of the rest, as many of the highest as are missing.
    missing = int(np.clip(wanted - always - walls, 0, plain.size - 1))
    return float(plain[plain.size - 1 - missing])


def _phantom(
    labels: NDArray[np.uint8],
    lattice: _kernels.Lattice,
    anatomy: _Anatomy,
    settings: GenerateSettings,
    seed: int,
    laterality: str,
) -> BreastPhantom:
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
        open_end=_open_end(anatomy.outline.axilla, laterality),
        source=f"generated ({settings.density_class}, seed {seed})",
    )


def _open_end(axilla: Axilla, laterality: str) -> OpenEnd:
    """The cut towards the axilla, and the plane beyond which only oblique views hold tissue."""
    side = 1.0 if laterality == "L" else -1.0
    angles = np.deg2rad([CUT_DEG, OFF_DEG])
    out, off = (np.array([0.0, side * np.cos(angle), np.sin(angle)]) for angle in angles)
    return OpenEnd(axilla.cut_mm * out, out, axilla.off_mm * off, off)

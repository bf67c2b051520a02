"""A breast from a seed: shape, muscle, ducts and lobes, fat lobules, ligaments, vessels, skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.config import documents_keys, given_settings
from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._block_kernels import SKIN_DEPTH, SKIN_MM, Lattice, Paint, Texture
from mammosim.phantom.anatomy._grain_kernels import TILE
from mammosim.phantom.anatomy._net_kernels import Net
from mammosim.phantom.anatomy._parenchyma_kernels import (
    IN_MUSCLE,
    TUBE,
    UNDECIDED,
    sample_potential,
)
from mammosim.phantom.anatomy._tissue_kernels import paint_tissue
from mammosim.phantom.anatomy._tube_kernels import paint_threads, paint_tubes
from mammosim.phantom.anatomy.axilla import CUT_DEG, draw_axilla
from mammosim.phantom.anatomy.ducts import grow_ducts
from mammosim.phantom.anatomy.findings import Ball, Fold, Site, draw_findings, paint_findings
from mammosim.phantom.anatomy.keys import OtherGenerateKeys
from mammosim.phantom.anatomy.lobules import (
    FINE_MM,
    LOBULE_MM,
    draw_net,
    lobule_coordinates,
    septum_mm,
)
from mammosim.phantom.anatomy.muscle import (
    BUNDLE_MM,
    COVER_MM,
    FAT_IN_MUSCLE,
    draw_muscle,
    fibre_coordinates,
    fit_volume,
    muscle_depth,
)
from mammosim.phantom.anatomy.nipple import Areola, Nipple, draw_areola, draw_nipple, varied
from mammosim.phantom.anatomy.noise import noise_tile
from mammosim.phantom.anatomy.outline import GRID_MM, Outline, coarse_frame, held_depth, skin_depth
from mammosim.phantom.anatomy.parenchyma import (
    Parenchyma,
    draw_parenchyma,
    gland_potential,
    gland_room,
)
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.shape import TYPICAL_ML, draw_shape, like
from mammosim.phantom.anatomy.skin import skin_mm
from mammosim.phantom.anatomy.threads import Threads, Tissue, draw_threads
from mammosim.phantom.anatomy.tubes import Tubes, gather_tubes
from mammosim.phantom.anatomy.vessels import grow_vessels
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

FAN_SHARE, FAN_PER_RADIAN = (0.46, 0.34, 0.24), (6.0, 14.0, 32.0)
"""Strands: relative amplitude, and waves per radian seen from behind the nipple."""

GRAIN_AMPLITUDE, GRAIN_MM = (0.14, 0.16), (5.0, 2.0)
"""Isotropic detail, by amplitude and wavelength, until projections have the exponent of
mammograms, 2.8 on average and 1.5 to 3.5 over breasts (Burgess 2003, Proc SPIE 5034)."""

NOISE_LIMIT = 1.5
"""Strands and grain together count for no more: beyond it blocks are decided without them."""

FINE_AMPLITUDE, FINE_LIMIT = 0.42, 2.6
"""Amplitude of the finest noise, wavelengths 0.5 to 4 mm, and where it is cut off, in standard
deviations. Chosen by eye."""

GLAND_CAP = 0.42
"""The potential above the threshold counts for no more: holes of fat, an eighth of the volume, stay
within compact gland. Chosen by eye."""

MUSCLE_STREAKS = 1.3
"""Standard deviations of the finest noise above which muscle is fat: a tenth of it."""

FINE_SEPTUM = 0.4
"""Thickness of the septa within lobules against those between them. Chosen by eye."""

FINE_LOBULES = 0.7
"""How strongly, and over which depth, lobules of the finer net push gland aside, against those of
the coarse one. Chosen by eye."""

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
        Voxel size, mm, default 0.2. The anatomy is the same at every size.
    seed : int
        Seed, 0 or more: the same seed gives the same voxels whatever the number of threads.
    laterality : {"L", "R"}
        The right breast of a seed is the other breast of the same woman: alike in size, shape and
        way in which gland lies, but not its mirror image.
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
    2 mm. Fat lobules are the cells of a power diagram in coordinates that are bent and drawn
    together at the nipple; their walls are septa, thinner than a voxel where they are: labels
    stand for an eighth, a quarter, a half or all of a voxel, drawn so that the mean is right.
    Gland is where the fields with strands towards the nipple exceed a threshold, pushed aside by
    lobules; the threshold meets the class's share of gland, ducts and terminal units of all
    within the skin but muscle. Surfaces of skin are dithered within a voxel, so that their
    staircase draws no contour lines. The breast is at rest without gravity. Ribs, the abdominal
    wall below the inframammary fold and Montgomery's glands are not modelled.
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
    """What a seed decides before any voxel is made."""

    outline: Outline
    frame: VoxelFrame
    kind: Parenchyma
    fields: NDArray[np.float32]
    tubes: Tubes
    threads: Threads
    nets: tuple[Net, Net, Net]
    tile: NDArray[np.int8]
    nipple: Nipple
    areola: Areola
    findings: list[Ball | Fold]


def _generate(settings: GenerateSettings, seed: int, laterality: str) -> BreastPhantom:
    anatomy = _anatomy(settings, seed, laterality)
    lattice = _lattice(anatomy, settings.voxel_mm)
    texture, paint = _texture(anatomy, seed), _paint(anatomy)
    labels = np.zeros(
        (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size), np.uint8
    )
    tubes, threads = anatomy.tubes, anatomy.threads
    paint_threads(labels, lattice, threads.ends_mm, threads.radius_mm, paint.labels, seed & 0xFFFF)
    paint_tubes(labels, lattice, tubes.ends_mm, tubes.radius_mm, tubes.label)
    paint = paint._replace(
        threshold=_threshold(labels, lattice, texture, paint, settings.target_percent)
    )
    paint_tissue(_dealt(lattice.x_start.size - 1), labels, lattice, texture, paint)
    paint_findings(labels, lattice, anatomy.findings, np.random.default_rng([seed, 5]))
    return _phantom(labels, lattice, anatomy, settings, seed, laterality)


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
    return _volume_ml(settings, _woman(seed)[0], _breast(seed, laterality)[0])


def _woman(seed: int) -> list[np.random.Generator]:
    """Streams of what both breasts of a woman share: of shape and of how gland lies."""
    return np.random.default_rng(seed).spawn(2)


def _breast(seed: int, laterality: str) -> list[np.random.Generator]:
    """Streams of one breast's own: size, shape, fields, lobules, ducts, vessels, threads and
    findings."""
    return np.random.default_rng([seed, "LR".index(laterality) + 1]).spawn(8)


def _volume_ml(
    settings: GenerateSettings, shared: np.random.Generator, own: np.random.Generator
) -> float:
    drawn = np.exp(VOLUME_SPREAD * shared.standard_normal())
    sides = np.exp(SIDES_SPREAD * np.clip(own.standard_normal(), -2.0, 2.0))
    return settings.volume_ml or float(np.clip(TYPICAL_ML * drawn * sides, *VOLUMES_ML))


def _anatomy(settings: GenerateSettings, seed: int, laterality: str = "L") -> _Anatomy:
    shared, how_gland_lies = _woman(seed)
    size_rng, shape_rng, field_rng, lobule_rng, duct_rng, vessel_rng, thread_rng, finding_rng = (
        _breast(seed, laterality)
    )
    volume_ml = _volume_ml(settings, shared, size_rng)
    skin = float(np.clip(shared.normal(1.45, 0.18), 1.2, 2.0))
    nipple = varied(draw_nipple(settings, shared), settings, shape_rng)
    shape = like(draw_shape(volume_ml, shared), shape_rng)
    axilla, muscle = draw_axilla(shape, shared), draw_muscle(shared)
    areola = draw_areola(shared)
    outline = fit_volume(Outline(shape, axilla), muscle, volume_ml)
    frame = coarse_frame(outline)
    depth, muscled = skin_depth(outline, frame), muscle_depth(muscle, outline, frame)
    kind = draw_parenchyma(settings.density_class, how_gland_lies)
    room = gland_room(outline, kind, depth, muscled, frame, field_rng)
    ends = np.array([outline.shape.depth_mm, outline.shape.depth_mm + nipple.height_mm])
    trees = grow_ducts(room, frame, ends, kind.units_a_lobe, duct_rng)
    gland = gland_potential(room, trees, kind, outline.shape.depth_mm, frame, field_rng)
    bent = lobule_coordinates(outline, frame, lobule_rng)
    fibres = fibre_coordinates(outline, frame, lobule_rng)
    septum = septum_mm(depth, kind.septum_mm, frame, lobule_rng)
    thickness = skin_mm(settings.skin_mm or skin, frame, field_rng)
    channels = [depth, muscled, gland, septum, thickness, *bent, *fibres]
    fields = np.stack(np.broadcast_arrays(*channels), axis=-1).astype(np.float32)
    lobule = LOBULE_MM * kind.lobule_size
    nets = (
        draw_net(bent, lobule, lobule_rng),
        draw_net(bent, FINE_MM, lobule_rng),
        draw_net(fibres, BUNDLE_MM, lobule_rng),
    )
    vessels = grow_vessels(outline, depth, muscled, frame, vessel_rng)
    tubes = gather_tubes([*vessels, *trees.pieces])
    tissue = Tissue(depth, muscled, room, frame)
    threads = draw_threads(tissue, ends[0], kind.threads, thread_rng)
    tile = noise_tile(thread_rng, TILE, FINE_LIMIT)
    site = Site(depth, muscled, thickness, frame, outline.axilla, ends[:1] * [1.0, 0.0, 0.0], tubes)
    findings = draw_findings(settings, site, finding_rng)
    return _Anatomy(
        outline, frame, kind, fields, tubes, threads, nets, tile, nipple, areola, findings
    )


def _dealt(layers: int) -> NDArray[np.int64]:
    """Order in which layers are dealt out, so that each thread has some of all parts."""
    return np.concatenate([np.arange(first, layers, 16) for first in range(16)])


def _lattice(anatomy: _Anatomy, voxel_mm: float) -> Lattice:
    """Voxel centres from the chest wall to two voxels of air around breast and nipple."""
    depth, origin = anatomy.fields[..., SKIN_DEPTH], anatomy.frame.origin_mm
    inside = np.argwhere(depth > 0)
    at = origin[1:] + inside[:, 1:] * GRID_MM
    cut = _cut(anatomy.outline)
    inside = inside[at @ cut[:2] < cut[2] + GRID_MM]
    low = origin + (inside.min(axis=0) - 1) * GRID_MM
    high = origin + (inside.max(axis=0) + 1) * GRID_MM
    front = anatomy.outline.shape.depth_mm + max(anatomy.nipple.height_mm, 0.0) + 2.0 * voxel_mm
    count = np.ceil((np.array([front, *high[1:]]) + voxel_mm) / voxel_mm).astype(int)
    first = np.floor((low - voxel_mm) / voxel_mm).astype(int)
    axes = [
        (np.arange(start, end) + 0.5) * voxel_mm
        for start, end in zip((0, first[1], first[2]), count, strict=True)
    ]
    starts = [
        np.searchsorted(axis, origin[n] + GRID_MM * np.arange(anatomy.frame.shape[n]))
        for n, axis in enumerate(axes)
    ]
    x, lateral, superior = axes
    x_start, lateral_start, superior_start = starts
    return Lattice(x, lateral, superior, origin, GRID_MM, x_start, lateral_start, superior_start)


def _texture(anatomy: _Anatomy, seed: int) -> Texture:
    kind = anatomy.kind
    return Texture(
        anatomy.fields, *anatomy.nets, FINE_SEPTUM, FINE_LOBULES,
        np.array([anatomy.outline.shape.depth_mm + 5.0, 0.0, 0.0]),
        kind.strands * np.array(FAN_SHARE), np.array(FAN_PER_RADIAN),
        np.array(GRAIN_AMPLITUDE), np.array(GRAIN_MM), NOISE_LIMIT, kind.lobule_mm, kind.lobules,
        anatomy.tile, FINE_AMPLITUDE * FINE_LIMIT / 127.0, GLAND_CAP,
        FINE_AMPLITUDE * MUSCLE_STREAKS,
        seed & 0xFFFFFF,
    )  # fmt: skip


def _cut(outline: Outline) -> NDArray[np.float64]:
    """Direction out of the open end (lateral, superior) and its distance from the x axis, mm."""
    angle = np.deg2rad(CUT_DEG)
    return np.array([np.cos(angle), np.sin(angle), outline.axilla.cut_mm])


def _paint(anatomy: _Anatomy) -> Paint:
    names = (
        "adipose", "skin", "gland", "nipple", "muscle", "ligament", "ligament_eighth",
        "ligament_quarter", "ligament_half",
    )  # fmt: skip
    areola = anatomy.areola
    return Paint(
        anatomy.nipple.numbers(anatomy.outline.shape.depth_mm, areola.root_mm),
        np.array([areola.thicker_mm, areola.radius_mm]),
        _cut(anatomy.outline), COVER_MM, 0.0,
        np.array([TISSUES[name].label for name in names], np.uint8),
    )  # fmt: skip


def _threshold(
    labels: NDArray[np.uint8],
    lattice: Lattice,
    texture: Texture,
    paint: Paint,
    percent: float,
) -> float:
    """Potential above which tissue is gland, so that the fibroglandular share is met."""
    shape = (*(side - 1 for side in texture.fields.shape[:3]), 4)
    potential, state = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
    sample_potential(_dealt(shape[0]), labels, lattice, texture, paint, potential, state)
    muscle = np.count_nonzero(state == IN_MUSCLE)
    # Fat within muscle counts as breast; gland has no part in it.
    counted = np.count_nonzero(state) - (1.0 - FAT_IN_MUSCLE) * muscle
    wanted = percent / 100.0 * counted
    ducts = np.count_nonzero(state == TUBE)
    free = np.sort(potential[state == UNDECIDED])
    # Ducts and units count whatever the threshold; of the rest, as many of the highest as miss.
    missing = int(np.clip(wanted - ducts, 0, free.size - 1))
    return float(free[free.size - 1 - missing])


def _phantom(
    labels: NDArray[np.uint8],
    lattice: Lattice,
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
        open_end=_open_end(anatomy, laterality),
        source=f"generated ({settings.density_class}, seed {seed})",
    )


def _open_end(anatomy: _Anatomy, laterality: str) -> OpenEnd:
    """The cut towards the axilla, and the skin of views that hold no axilla."""
    side = 1.0 if laterality == "L" else -1.0
    angle = np.deg2rad(CUT_DEG)
    out = np.array([0.0, side * np.cos(angle), np.sin(angle)])
    frame, outline = anatomy.frame, anatomy.outline
    depth = held_depth(outline, frame).astype(np.float32)
    origin = frame.origin_mm.copy()
    if laterality == "R":
        depth = np.ascontiguousarray(depth[:, ::-1])
        origin[1] = -(origin[1] + frame.spacing_mm[1] * (frame.shape[1] - 1))
    held_frame = VoxelFrame(origin, frame.spacing_mm, frame.shape)
    skin = float(anatomy.fields[..., SKIN_MM].mean())
    return OpenEnd(outline.axilla.cut_mm * out, out, depth, held_frame, skin)

"""A breast from a seed: shape, muscle, ducts and lobes, fat lobules, ligaments, vessels, skin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim._heap import return_freed_memory, share_heap
from mammosim._side_by_side import both, dealt
from mammosim.config import documents_keys, given_settings
from mammosim.errors import InputError
from mammosim.phantom.anatomy._block_kernels import SKIN_MM, Lattice, Paint, Texture
from mammosim.phantom.anatomy._grain_kernels import TILE, TILE_LIMIT, TILE_STEP
from mammosim.phantom.anatomy._net_kernels import Net
from mammosim.phantom.anatomy._sample_kernels import (
    IN_MUSCLE,
    NOT_COUNTED,
    SAMPLES,
    TUBE,
    UNDECIDED,
    sample_potential,
)
from mammosim.phantom.anatomy._tissue_kernels import paint_tissue
from mammosim.phantom.anatomy._tube_kernels import paint_threads, paint_tubes
from mammosim.phantom.anatomy.body import (
    Body,
    draw_body,
    lattice_of,
    open_end_of,
    paint_of,
    phantom_of,
    streams_of_breast,
    streams_of_woman,
)
from mammosim.phantom.anatomy.ducts import DuctTrees, grow_ducts
from mammosim.phantom.anatomy.finding_bodies import Ball, Fold, paint_findings
from mammosim.phantom.anatomy.findings import Site, draw_findings
from mammosim.phantom.anatomy.keys import OtherGenerateKeys
from mammosim.phantom.anatomy.lobules import (
    FINE_MM,
    GLANDULAR,
    LOBULE_MM,
    draw_net,
    lobule_coordinates,
    septum_mm,
    settle_gland,
)
from mammosim.phantom.anatomy.muscle import BUNDLE_MM, fibre_coordinates
from mammosim.phantom.anatomy.noise import noise_tile
from mammosim.phantom.anatomy.parenchyma import (
    Parenchyma,
    draw_parenchyma,
    gland_potential,
    gland_region,
    gland_room,
)
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.skin import skin_mm
from mammosim.phantom.anatomy.threads import Threads, draw_threads
from mammosim.phantom.anatomy.tissue import Tissue
from mammosim.phantom.anatomy.tubes import Tubes, gather_tubes
from mammosim.phantom.anatomy.vessels import grow_vessels
from mammosim.phantom.breast import BreastPhantom

FAN_SHARE, FAN_PER_RADIAN = (0.30, 0.20), (6.0, 14.0)
"""Strands: relative amplitude, and waves per radian seen from behind the nipple."""

GRAIN_AMPLITUDE, GRAIN_MM = (0.14, 0.16), (5.0, 2.0)
"""Isotropic detail, by amplitude and wavelength, until projections have the exponent of
mammograms, 2.8 on average and 1.5 to 3.5 over breasts (Burgess 2003, Proc SPIE 5034)."""

NOISE_LIMIT = 0.9
"""Strands and grain together count for no more: beyond it blocks are decided without them."""

FINE_AMPLITUDE = 0.25
"""Standard deviation of the finest noise of gland, whose wavelengths are 0.5 to 4 mm. It roughens
the borders of gland; many rough borders over each other are a mottle in projection. Chosen by
eye."""

GLAND_CAP = 0.39
"""The potential above the threshold counts for no more: holes of fat, a twelfth of the volume,
stay within compact gland. More of them are a symmetric mottle in projection. Chosen by eye."""

NO_GLAND = -9.0
"""Potential in the abdominal wall: below any threshold."""

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
    staircase draws no contour lines. The breast is at rest without gravity. Of the
    abdominal wall there is only what oblique views show below the inframammary fold; ribs and
    Montgomery's glands are not modelled.
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

    body: Body
    kind: Parenchyma
    fields: NDArray[np.float32]
    tubes: Tubes
    threads: Threads
    nets: tuple[Net, Net]
    tile: NDArray[np.int8]
    findings: list[Ball | Fold]


def _generate(settings: GenerateSettings, seed: int, laterality: str) -> BreastPhantom:
    share_heap()
    anatomy = _anatomy(settings, seed, laterality)
    end = open_end_of(anatomy.body, laterality, float(anatomy.fields[..., SKIN_MM].mean()))
    return_freed_memory()  # to draw it took as much memory as labels do
    lattice = lattice_of(anatomy.body, settings.voxel_mm)
    texture, paint = _texture(anatomy, seed), paint_of(anatomy.body)
    labels = np.zeros(
        (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size), np.uint8
    )
    tubes, threads = anatomy.tubes, anatomy.threads
    paint_threads(labels, lattice, threads.ends_mm, threads.radius_mm, paint.labels, seed & 0xFFFF)
    paint_tubes(labels, lattice, tubes.ends_mm, tubes.radius_mm, tubes.label)
    paint = paint._replace(
        threshold=_threshold(labels, lattice, texture, paint, settings.target_percent, anatomy.body)
    )
    paint_tissue(dealt(lattice.x_start.size - 1), labels, lattice, texture, paint)
    paint_findings(labels, lattice, anatomy.findings)
    return phantom_of(labels, lattice, anatomy.body, settings, seed, laterality, end)


def _anatomy(settings: GenerateSettings, seed: int, laterality: str = "L") -> _Anatomy:
    _, how_gland_lies = streams_of_woman(seed)
    field_rng, lobule_rng, duct_rng, vessel_rng, thread_rng, finding_rng = streams_of_breast(
        seed, laterality
    )[2:]
    body = draw_body(settings, seed, laterality)
    outline, frame, depth, muscled = body.outline, body.frame, body.depth_mm, body.muscle_mm
    kind = draw_parenchyma(settings.density_class, how_gland_lies)
    share = settings.target_percent / 100.0
    gland, foam = both(
        partial(_draw_gland, body, kind, share, field_rng, duct_rng),
        partial(_draw_foam, body, kind, lobule_rng),
    )
    lobules, fine, bundles = foam.nets
    potential = settle_gland(
        lobules, foam.bent, gland.potential, gland.breast, share, kind.cells, lobule_rng
    )
    potential[body.own_mm < 0.0] = NO_GLAND
    channels = [depth, muscled, potential, foam.septum_mm, gland.skin_mm, *foam.bent, *foam.fibres]
    fields = np.stack(np.broadcast_arrays(*channels), axis=-1).astype(np.float32)
    vessels = grow_vessels(outline, depth, muscled, frame, vessel_rng)
    tubes = gather_tubes([*vessels, *gland.trees.pieces])
    tissue = Tissue(depth, muscled, foam.bent, frame)
    threads = draw_threads(tissue, (lobules, fine), kind.threads, kind.stoutness, thread_rng)
    tile = noise_tile(thread_rng, TILE, TILE_LIMIT)
    foot = np.array([outline.shape.depth_mm, 0.0, 0.0])
    site = Site(depth, muscled, gland.skin_mm, frame, outline.axilla, foot, tubes)
    findings = draw_findings(settings, site, finding_rng)
    return _Anatomy(body, kind, fields, tubes, threads, (lobules, bundles), tile, findings)


@dataclass(frozen=True, eq=False)
class _Gland:
    """Ducts, and on the coarse grid the skin's thickness, what lies within it in front of the
    muscle, and the potential of gland."""

    trees: DuctTrees
    skin_mm: NDArray[np.float64]
    breast: NDArray[np.bool_]
    potential: NDArray[np.float64]


def _draw_gland(
    body: Body, kind: Parenchyma, share: float, field_rng: np.random.Generator,
    duct_rng: np.random.Generator,
) -> _Gland:  # fmt: skip
    outline, frame, muscled = body.outline, body.frame, body.muscle_mm
    foot_mm = outline.shape.depth_mm
    room = gland_room(outline, kind, body.own_mm, body.behind_mm, frame, field_rng)
    ends = np.array([foot_mm, foot_mm + body.nipple.height_mm])
    trees = grow_ducts(room, frame, ends, kind.units_a_lobe, duct_rng)
    thickness = skin_mm(body.skin_mm, frame, field_rng)
    breast = (body.depth_mm > thickness) & (body.own_mm > 0.0) & (muscled < 0.0)
    room = gland_region(room, breast, kind.expanse * share)
    potential = gland_potential(room, trees, kind, foot_mm, frame, field_rng)
    return _Gland(trees, thickness, breast, potential)


@dataclass(frozen=True, eq=False)
class _Foam:
    """Coordinates of lobules and of the muscle's fibres, the thickness of walls, and the nets of
    lobules, of finer cells within them and of the muscle's bundles."""

    bent: list[NDArray[np.float64]]
    fibres: list[NDArray[np.float64]]
    septum_mm: NDArray[np.float64]
    nets: tuple[Net, Net, Net]


def _draw_foam(body: Body, kind: Parenchyma, rng: np.random.Generator) -> _Foam:
    bent = lobule_coordinates(body.outline, body.frame, rng)
    fibres = fibre_coordinates(body.muscle, body.outline, body.frame, rng)
    septum = septum_mm(body.depth_mm, kind.septum_mm, body.frame, rng)
    lobules = draw_net(bent, LOBULE_MM * kind.lobule_size, rng)
    fine = draw_net(bent, FINE_MM, rng)
    bundles = draw_net(fibres, BUNDLE_MM, rng, grouped=False)
    return _Foam(bent, fibres, septum, (lobules, fine, bundles))


def _texture(anatomy: _Anatomy, seed: int) -> Texture:
    kind = anatomy.kind
    return Texture(
        anatomy.fields, *anatomy.nets,
        np.array([anatomy.body.outline.shape.depth_mm + 5.0, 0.0, 0.0]),
        kind.strands * np.array(FAN_SHARE), np.array(FAN_PER_RADIAN),
        np.array(GRAIN_AMPLITUDE), np.array(GRAIN_MM), NOISE_LIMIT, kind.lobule_mm, kind.lobules,
        -GLANDULAR * kind.lobules,
        anatomy.tile, FINE_AMPLITUDE * TILE_STEP, GLAND_CAP, anatomy.body.muscle.streaks,
        seed & 0xFFFFFF,
    )  # fmt: skip


def _threshold(
    labels: NDArray[np.uint8],
    lattice: Lattice,
    texture: Texture,
    paint: Paint,
    percent: float,
    body: Body,
) -> float:
    """Potential above which tissue is gland, so that the fibroglandular share is met.

    Blocks whose middle is not in the breast itself do not count.
    """
    shape = (*(side - 1 for side in texture.fields.shape[:3]), SAMPLES)
    potential, state = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
    sample_potential(dealt(shape[0]), labels, lattice, texture, paint, potential, state)
    middle = ndimage.uniform_filter(body.own_mm, 2, origin=-1)[:-1, :-1, :-1]
    state[middle < 0.0] = NOT_COUNTED
    # Each stands for an equal part of its block's voxels.
    along = (np.diff(start) for start in lattice[-3:])
    block = np.einsum("i,j,k->ijk", *along)[..., None] / SAMPLES
    voxels = np.broadcast_to(block, shape)
    # Fat within muscle counts as breast; gland has no part in it.
    counted = voxels[state != NOT_COUNTED].sum()
    counted -= (1.0 - body.muscle.fat) * voxels[state == IN_MUSCLE].sum()
    # Ducts and units count whatever the threshold; of the rest, as many of the highest as miss.
    missing = percent / 100.0 * counted - voxels[state == TUBE].sum()
    free, filled = potential[state == UNDECIDED], voxels[state == UNDECIDED]
    order = np.argsort(-free, kind="stable")
    last = np.searchsorted(np.cumsum(filled[order]), missing)
    return float(free[order[min(int(last), order.size - 1)]])

"""A breast from a seed: shape, muscle, gland, fat lobules, ligaments, ducts, vessels, skin."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.config import to_settings
from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy import _kernels
from mammosim.phantom.anatomy.fields import PARENCHYMA, Parenchyma, envelope, septum_mm, warps
from mammosim.phantom.anatomy.muscle import COVER_MM, draw_muscle, fit_volume, muscle_depth
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.anatomy.shape import (
    GRID_MM,
    Shape,
    coarse_frame,
    draw_shape,
    skin_depth,
)
from mammosim.phantom.anatomy.tubes import grow_tubes
from mammosim.phantom.breast import BreastPhantom
from mammosim.phantom.orientation import nipple_position
from mammosim.tissues import TISSUES

LOBULE_MM = 11.0
"""Side of the cells that hold one fat lobule each, mm: lobules are 5 to 20 mm across."""

FAN_SHARE, FAN_PER_RADIAN = (0.47, 0.37, 0.31), (5.0, 11.0, 23.0)
"""Strands: relative amplitude, and waves per radian seen from behind the nipple."""

GRAIN_AMPLITUDE, GRAIN_MM = (0.15, 0.20, 0.26), (6.5, 3.1, 1.4)
"""Isotropic detail. Equal amplitude an octave would be a volume spectrum f^-3, whose exponent a
parallel projection keeps; the threshold smooths, so that finer octaves are made stronger until
projections have the exponent of mammograms, 2.8 on average and 1.5 to 3.5 over breasts (Burgess
1999, Proc SPIE 3659)."""

SAMPLE_MM = 1.5
"""Distance of the voxels on which the share of gland is set, mm."""


def generate_phantom(
    density: str = "scattered",
    voxel_mm: float = 0.5,
    seed: int = 1,
    laterality: str = "L",
    **settings: Any,
) -> BreastPhantom:
    """Make a breast.

    Parameters
    ----------
    density : {"fatty", "scattered", "heterogeneous", "dense", "a", "b", "c", "d"}
        Density class.
    voxel_mm : float
        Voxel size, mm. The anatomy is the same at every size.
    seed : int
        Seed, 0 or more: the same seed gives the same voxels whatever the number of threads.
    laterality : {"L", "R"}
        A right breast is the mirror image of the left one of its seed.
    **settings
        Other keys of `GenerateSettings`.

    Returns
    -------
    BreastPhantom
        The chest-wall plane is x = 0, the nipple's foot lies on the x axis.

    Raises
    ------
    InputError
        If a setting is not known or not allowed.

    Notes
    -----
    Smooth fields (distance to skin and muscle, where gland may be) are made on a grid of 2 mm;
    gland is where their sum with noise, strands towards the nipple and fat lobules exceeds a
    threshold, which is set so that the class's share of fibroglandular tissue (gland, ducts,
    units, ligaments and vessels, of all within the skin but muscle) is met. The breast is at
    rest without gravity. Ribs, lymph nodes and Montgomery's glands are not modelled.
    """
    if laterality not in ("L", "R"):
        raise InputError(f"laterality: found '{laterality}', expected L or R")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: found {seed!r}, expected a whole number of 0 or more")
    chosen = to_settings(
        GenerateSettings, {"density": density, "voxel_mm": voxel_mm, **settings}, "generate_phantom"
    )
    return _generate(chosen, int(seed), laterality)


def _generate(settings: GenerateSettings, seed: int, laterality: str) -> BreastPhantom:
    size_rng, field_rng, lobule_rng, tube_rng = np.random.default_rng(seed).spawn(4)
    shape = draw_shape(size_rng)
    muscle = draw_muscle(size_rng)
    drawn_ml = float(np.clip(size_rng.normal(620.0, 120.0), 350.0, 900.0))
    shape = fit_volume(shape, muscle, settings.volume_ml or drawn_ml)
    frame = coarse_frame(shape)
    depth, muscled = skin_depth(shape, frame), muscle_depth(muscle, shape, frame)
    kind = PARENCHYMA[settings.density_class]
    gland = envelope(shape, kind, depth, muscled, frame, field_rng)
    channels = [depth, muscled, gland, *warps(frame, field_rng), septum_mm(depth, frame, field_rng)]
    fields = np.stack(np.broadcast_arrays(*channels), axis=-1).astype(np.float32)
    tubes = grow_tubes(shape, depth, gland, muscled, frame, settings.nipple_height_mm, tube_rng)
    lattice = _lattice(depth, shape, settings, frame.origin_mm)
    texture = _texture(fields, frame.origin_mm, shape, kind, seed, lobule_rng)
    labels = np.zeros(
        (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size), np.uint8
    )
    _kernels.paint_tubes(labels, lattice, tubes.ends_mm, tubes.radius_mm, tubes.label)
    paint = _paint(settings, shape, threshold=0.0)
    paint = paint._replace(
        threshold=_threshold(labels, lattice, texture, paint, settings.target_percent)
    )
    _kernels.paint_tissue(labels, lattice, texture, paint)
    return _phantom(labels, lattice, settings, seed, laterality)


def _lattice(
    skin_depth_mm: NDArray[np.float64],
    shape: Shape,
    settings: GenerateSettings,
    coarse_origin_mm: NDArray[np.float64],
) -> _kernels.Lattice:
    """Voxel centres from the chest wall to two voxels of air around breast and nipple."""
    voxel = settings.voxel_mm
    inside = np.argwhere(skin_depth_mm > 0)
    low = coarse_origin_mm + (inside.min(axis=0) - 1) * GRID_MM
    high = coarse_origin_mm + (inside.max(axis=0) + 1) * GRID_MM
    front = shape.depth_mm + settings.nipple_height_mm + 2.0 * voxel
    count = np.ceil((np.array([front, *high[1:]]) + voxel) / voxel).astype(int)
    first = np.floor((low - voxel) / voxel).astype(int)
    return _kernels.Lattice(
        (np.arange(count[0]) + 0.5) * voxel,
        (np.arange(first[1], count[1]) + 0.5) * voxel,
        (np.arange(first[2], count[2]) + 0.5) * voxel,
        coarse_origin_mm,
        GRID_MM,
    )


def _texture(
    fields: NDArray[np.float32],
    origin_mm: NDArray[np.float64],
    shape: Shape,
    kind: Parenchyma,
    seed: int,
    rng: np.random.Generator,
) -> _kernels.Texture:
    extent = np.array(fields.shape[:3]) * GRID_MM
    cells = np.ceil(extent / LOBULE_MM).astype(int) + 2
    seeds = np.empty((*cells, 4), np.float32)
    seeds[..., :3] = rng.uniform(0.12, 0.88, (*cells, 3))
    seeds[..., 3] = rng.gamma(2.0, 0.9, tuple(cells))
    return _kernels.Texture(
        fields, seeds, origin_mm - LOBULE_MM, LOBULE_MM,
        np.array([shape.depth_mm + 5.0, 0.0, 0.0]),
        kind.strands * np.array(FAN_SHARE), np.array(FAN_PER_RADIAN),
        np.array(GRAIN_AMPLITUDE), np.array(GRAIN_MM), kind.lobules, seed & 0xFFFFFF,
    )  # fmt: skip


def _paint(settings: GenerateSettings, shape: Shape, threshold: float) -> _kernels.Paint:
    nipple = [shape.depth_mm, settings.nipple_height_mm, 0.5 * settings.nipple_diameter_mm]
    names = ("adipose", "skin", "gland", "nipple", "muscle", "ligament")
    return _kernels.Paint(
        settings.skin_mm, np.array(nipple), COVER_MM, threshold,
        *(TISSUES[name].label for name in names),
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
    tissue = state > 0
    wanted = percent / 100.0 * tissue.sum()
    always = np.count_nonzero(state == 3)
    plain, walls = np.sort(potential[state == 1]), np.count_nonzero(state == 2)
    # Walls count whatever the threshold; of the rest, as many of the highest as are missing.
    missing = int(np.clip(wanted - always - walls, 0, plain.size - 1))
    return float(plain[plain.size - 1 - missing])


def _phantom(
    labels: NDArray[np.uint8],
    lattice: _kernels.Lattice,
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
        source=f"generated ({settings.density_class}, seed {seed})",
    )

"""Where glandular tissue lies in a breast, on the coarse grid: the room it has, lobes, walls."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.ducts import DuctTrees, tree_distance
from mammosim.phantom.anatomy.lobules import across_and_pressed
from mammosim.phantom.anatomy.noise import noise_over, smooth_noise
from mammosim.phantom.anatomy.outline import Outline, mesh, steepness


@dataclass(frozen=True)
class Parenchyma:
    """How glandular tissue lies in a breast of a density class.

    Parameters
    ----------
    fat_mm : float
        Subcutaneous fat at the back of the breast, mm; it thins towards the nipple.
    cone_deg : float
        Half angle at the nipple of the cone that holds the gland, degrees.
    units_a_lobe : float
        Terminal units of a lobe's duct tree.
    sleeve_mm : float
        How far glandular tissue keeps to its ducts, mm.
    plate : float
        Half the thickness of the plate in which gland lies, along the direction in which plates
        press, against the breast's radius.
    expanse : float
        Volume of the region in which gland lies, against that of gland.
    cells : float
        Volume of the cells of the foam that are lobes of gland, and push none aside, against that
        of gland: they have holes of fat, and gland also lies between fat lobules.
    behind_mm : float
        Fat between gland and the pectoral muscle's front in a breast that is `TYPICAL_DEPTH_MM`
        deep, mm; in others it changes with the depth.
    threads, stoutness : float
        Number and radius of fibrous threads against the mean.
    patchiness, strands, lobules : float
        Amplitude of lobes of gland and of the fat between them, of strands that run towards the
        nipple, and of fat lobules that push gland aside.
    lobule_mm : float
        Depth within a fat lobule over which it pushes gland aside fully, mm.
    septum_mm : float
        Mean thickness of the walls between fat lobules, mm.
    lean_deg : float
        How much wider the cone is towards the upper outer quadrant, degrees.
    lobule_size : float
        Size of fat lobules against the mean.
    """

    fat_mm: float
    cone_deg: float
    units_a_lobe: float
    sleeve_mm: float
    plate: float
    expanse: float
    cells: float
    behind_mm: float
    threads: float = 1.0
    stoutness: float = 1.0
    patchiness: float = 1.2
    strands: float = 0.6
    lobules: float = 2.8
    lobule_mm: float = 1.4
    septum_mm: float = 0.25
    lean_deg: float = 9.0
    lobule_size: float = 1.0


PARENCHYMA: MappingProxyType[str, Parenchyma] = MappingProxyType(
    {
        "fatty": Parenchyma(12.0, 46.0, 9.0, 5.0, 0.3, 5.0, 0.25, 20.0, 1.05, 0.92),
        "scattered": Parenchyma(10.5, 46.0, 22.0, 6.0, 0.25, 1.8, 0.75, 18.0),
        "heterogeneous": Parenchyma(8.5, 58.0, 32.0, 7.0, 0.35, 1.6, 0.65, 14.0, 1.4, 1.2),
        "dense": Parenchyma(6.0, 70.0, 42.0, 8.0, 0.6, 1.4, 0.65, 10.0, 1.6, 1.35),
    }
)
"""Chosen by eye on projections, so that each class looks like mammograms of its BI-RADS letter;
subcutaneous fat of 5 to 15 mm and a cone at the nipple follow anatomical drawings (Cooper 1840).
In dense ones a third of the gland is not whole lobes but coats the walls of fat lobules, and there
are more and stouter fibres: without them lines hardly show beside gland. In fatty ones the little
gland there is lies in strands along walls over much of the breast, only a quarter is whole lobes,
and fibres are finer."""

SLEEVE = 0.7
"""Amplitude of the preference of gland for the neighbourhood of ducts. Chosen."""

BEHIND_NIPPLE, BEHIND_NIPPLE_MM, BEHIND_SLEEVE_MM = 4.0, 20.0, 2.0
"""The same for fibrous tissue around the main ducts, the distance from the nipple over which it is
lost, and how far it keeps to them, mm: ducts are seen to run into the nipple. Chosen by eye."""


PLATE_OFFSET = (0.08, 0.08)
"""Mean and spread of how far that plate's middle is above the nipple, against the breast's radius.
Chosen by eye."""

FAN_APEX_MM, FAN_MM, FAN_REACH_MM = 22.0, 50.0, 120.0
"""Where lobes converge, in front of the nipple's foot; distance from there at which their
coordinates are lengths, and how far these reach, mm. Chosen by eye."""

LOBE_LENGTH, LOBE_HEIGHT = 1.7, 2.4
"""Length of lobes against their width along the way from the nipple and along the direction in
which plates press. Chosen by eye on projections."""

PATCHES = ((0.55, 32.0), (0.8, 15.0))
"""Amplitude and wavelength of lobes of gland and of the fat between them, mm. Chosen by eye."""

OUTSIDE, WITHIN = 2.0, 0.35
"""Slope of the potential outside and within the region of gland, against that of the room.
Chosen by eye."""

INTO_FAT = 9.0
"""How much more steeply the room for gland falls within subcutaneous fat than below it: a muscle
that takes the room behind leaves gland less of it, not less fat before it. Chosen."""

BACK_MM = 2.5
"""Length over which the room falls by one towards the muscle, mm: where there is too little of it,
gland spreads backward before it spreads towards the skin. Chosen."""

AHEAD, AHEAD_SHARE = 1.0, 0.6
"""Amplitude of the preference of gland for the front of the breast, and the distance from the
nipple at which there is none, against the breast's depth. Chosen by eye."""


TYPICAL_DEPTH_MM, BEHIND_SPREAD = 62.0, 0.25
"""Depth of a median breast at rest, mm, and spread over women of the logarithm of the retromammary
fat. Gland is densest in front and sparse near the chest wall (88 breast CTs: Fedon et al. 2021),
and anatomical drawings show a layer of fat in front of the muscle; its thickness is assumed."""

MIN_ROOM = -12.0
"""Least room, far within fat: lobes that differ by a few units of the potential keep out of it.
Chosen."""


def draw_parenchyma(density: str, rng: np.random.Generator) -> Parenchyma:
    """That of a density class with the differences between women: a fifth or so, by choice."""
    kind = PARENCHYMA[density]
    keys = (
        "fat_mm",
        "cone_deg",
        "sleeve_mm",
        "patchiness",
        "strands",
        "lobules",
        "units_a_lobe",
        "septum_mm",
        "plate",
        "expanse",
        "cells",
    )
    factors = np.exp(0.2 * rng.standard_normal(len(keys)).clip(-2.0, 2.0))
    changed = {
        key: float(getattr(kind, key) * factor) for key, factor in zip(keys, factors, strict=True)
    }
    changed["cone_deg"] = min(changed["cone_deg"], 80.0)
    size = float(np.exp(0.15 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    lean = float(rng.uniform(8.0, 28.0))
    threads = kind.threads * float(np.exp(0.35 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    fat = float(np.exp(BEHIND_SPREAD * np.clip(rng.standard_normal(), -2.0, 2.0)))
    return replace(
        kind,
        **changed,
        lean_deg=lean,
        lobule_size=size,
        threads=threads,
        behind_mm=kind.behind_mm * fat,
    )


def gland_room(
    outline: Outline,
    kind: Parenchyma,
    own_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """What skin, chest wall and the cone at the nipple leave for gland: 1 inside, then falling.

    The least of the three, smoothly taken.
    """
    x, lateral, superior = mesh(frame)
    shape = outline.shape
    ahead = shape.depth_mm + 4.0 - x
    across = np.hypot(lateral, superior)
    distance = np.hypot(ahead, across)
    back = np.clip(distance / (0.9 * shape.depth_mm), 0.0, 1.0)
    uneven = smooth_noise(rng, frame, 30.0)
    fat = 2.0 + (kind.fat_mm * np.clip(1.0 + 0.3 * uneven, 0.5, 1.7) - 2.0) * back**0.8
    from_skin = (own_depth_mm - fat) / 5.0
    from_skin = np.minimum(from_skin, INTO_FAT * from_skin)
    layer_mm = kind.behind_mm * shape.depth_mm / TYPICAL_DEPTH_MM
    behind = layer_mm * np.clip(1.0 + 0.3 * smooth_noise(rng, frame, 35.0), 0.4, 1.6)
    # The muscle's depth is along x; its front is up to twice as steep.
    from_muscle = (-muscle_depth_mm / steepness(muscle_depth_mm) - behind) / BACK_MM
    # The gland leans to the upper outer quadrant, where most of it is.
    lean = np.cos(np.arctan2(superior, lateral) - np.deg2rad(rng.normal(50.0, 15.0)))
    slant = np.rad2deg(np.arctan2(across, ahead))
    in_cone = (kind.cone_deg + kind.lean_deg * lean - slant) / 18.0
    # It is a plate across the direction in which plates press, bent and uneven.
    _, pressed = across_and_pressed(lateral, superior)
    middle = shape.radius_mm * (rng.normal(*PLATE_OFFSET) + 0.08 * smooth_noise(rng, frame, 40.0))
    half = kind.plate * shape.radius_mm * (1.0 + 0.25 * smooth_noise(rng, frame, 30.0))
    in_plate = (half - np.abs(pressed - middle)) / 8.0
    inside = np.full_like(back, 1.3)
    limits = np.stack(np.broadcast_arrays(from_skin, from_muscle, in_cone, in_plate, inside))
    sharp = 2.5
    # Lobes fan out from the nipple; towards the chest wall they end one after the other.
    forward = AHEAD * (1.0 - distance / (AHEAD_SHARE * shape.depth_mm)).clip(-1.0, 1.0)
    least = forward - np.log(np.exp(-sharp * limits.clip(MIN_ROOM, 6.0)).sum(axis=0)) / sharp
    return np.clip(least, MIN_ROOM, None)


def gland_region(
    room: NDArray[np.float64], breast: NDArray[np.bool_], volume: float
) -> NDArray[np.float64]:
    """The room for gland turned into a region of a given share of the breast.

    Nearly even within, so that lobes and fat share it, and falling outside.
    """
    above = room - np.quantile(room[breast], max(1.0 - volume, 0.0))
    region: NDArray[np.float64] = np.minimum(OUTSIDE * above, WITHIN * above)
    return region


def gland_potential(
    room: NDArray[np.float64],
    trees: DuctTrees,
    kind: Parenchyma,
    foot_mm: float,
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Potential of glandular tissue without its fine structure.

    The room it has, near ducts more than away from them, most of all behind the nipple, lobes of
    unequal strength, and patches. `foot_mm` is x of the nipple's foot.
    """
    distance, lobe = tree_distance(trees, room, frame)
    sleeve = SLEEVE * (np.exp(-((distance / kind.sleeve_mm) ** 2)) - 0.5)
    strength = 0.30 * rng.standard_normal(int(trees.lobe.max()) + 1)
    x, lateral, superior = mesh(frame)
    from_nipple = np.sqrt((x - foot_mm) ** 2 + lateral**2 + superior**2)
    sleeve = sleeve + BEHIND_NIPPLE * np.exp(
        -((distance / BEHIND_SLEEVE_MM) ** 2) - from_nipple / BEHIND_NIPPLE_MM
    )
    lobes = ndimage.gaussian_filter(strength[lobe], 1.5)
    return room + sleeve + lobes + gland_patches(room, kind, foot_mm, frame, rng)


def lobe_coordinates(foot_mm: float, frame: VoxelFrame) -> list[NDArray[np.float64]]:
    """Coordinates in which lobes are of equal size: they fan out from the nipple.

    Along the way from the nipple, across, and along the direction in which plates press, each
    divided by how much longer lobes are that way.
    """
    x, lateral, superior = mesh(frame)
    behind = np.maximum(foot_mm + FAN_APEX_MM - x, FAN_APEX_MM)
    scale = FAN_MM / behind
    across, pressed = across_and_pressed(lateral, superior)
    away = np.sqrt(behind**2 + lateral**2 + superior**2) / LOBE_LENGTH
    parts = (away, across * scale, pressed * scale / LOBE_HEIGHT)
    return [np.clip(part, -FAN_REACH_MM, FAN_REACH_MM) for part in np.broadcast_arrays(*parts)]


def gland_patches(
    room: NDArray[np.float64],
    kind: Parenchyma,
    foot_mm: float,
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """What lobes of gland and the fat between them add to the potential."""
    fan = lobe_coordinates(foot_mm, frame)
    patches = sum(share * noise_over(rng, fan, wavelength) for share, wavelength in PATCHES)
    # Patches fill the room that gland has; they hardly carry it into the fat beyond.
    held = np.where(patches > 0.0, np.clip(0.5 + 0.5 * room, 0.0, 1.0), 1.0)
    added: NDArray[np.float64] = kind.patchiness * held * patches
    return added

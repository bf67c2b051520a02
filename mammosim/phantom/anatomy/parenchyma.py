"""Where glandular tissue lies in a breast, on the coarse grid: the room it has, lobes, walls."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.ducts import DuctTrees, tree_distance
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import Outline, mesh


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
    patchiness, strands, lobules : float
        Amplitude of noise of 12 and 25 mm, of noise that runs towards the nipple, and of fat
        lobules that push gland aside.
    lobule_mm : float
        Depth within a fat lobule over which it pushes gland aside fully, mm.
    septum_mm : float
        Mean thickness of the walls between fat lobules, mm.
    lean_deg : float
        How much wider the cone is towards the upper outer quadrant, degrees.
    lobule_size : float
        Size of fat lobules against the mean.
    threads : float
        Number of fibrous threads against the mean.
    """

    fat_mm: float
    cone_deg: float
    units_a_lobe: float
    sleeve_mm: float
    patchiness: float
    strands: float
    lobules: float
    lobule_mm: float
    septum_mm: float
    lean_deg: float = 9.0
    lobule_size: float = 1.0
    threads: float = 1.0


PARENCHYMA: MappingProxyType[str, Parenchyma] = MappingProxyType(
    {
        "fatty": Parenchyma(12.0, 40.0, 14.0, 5.0, 0.85, 0.50, 2.8, 2.6, 0.25),
        "scattered": Parenchyma(10.5, 46.0, 22.0, 6.0, 0.80, 0.45, 2.6, 2.6, 0.25),
        "heterogeneous": Parenchyma(8.5, 58.0, 32.0, 7.0, 0.65, 0.40, 3.0, 2.6, 0.25),
        "dense": Parenchyma(6.0, 70.0, 42.0, 8.0, 0.40, 0.35, 2.8, 2.6, 0.25),
    }
)
"""Chosen by eye on projections, so that each class looks like mammograms of its BI-RADS letter;
subcutaneous fat of 5 to 15 mm and a cone at the nipple follow anatomical drawings (Cooper 1840)."""

SLEEVE = 0.9
"""Amplitude of the preference of gland for the neighbourhood of ducts. Chosen."""

BEHIND_NIPPLE, BEHIND_NIPPLE_MM, BEHIND_SLEEVE_MM = 1.6, 16.0, 2.5
"""The same for fibrous tissue around the main ducts, the distance from the nipple over which it is
lost, and how far it keeps to them, mm: ducts are seen to run into the nipple. Chosen by eye."""


AHEAD, AHEAD_SHARE = 0.7, 0.55
"""Amplitude of the preference of gland for the front of the breast, and the distance from the
nipple at which there is none, against the breast's depth. Chosen by eye."""


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
    )
    factors = np.exp(0.2 * rng.standard_normal(len(keys)).clip(-2.0, 2.0))
    changed = {
        key: float(getattr(kind, key) * factor) for key, factor in zip(keys, factors, strict=True)
    }
    changed["cone_deg"] = min(changed["cone_deg"], 80.0)
    size = float(np.exp(0.15 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    lean = float(rng.uniform(4.0, 16.0))
    threads = float(np.exp(0.35 * np.clip(rng.standard_normal(), -2.0, 2.0)))
    return replace(kind, **changed, lean_deg=lean, lobule_size=size, threads=threads)


def gland_room(
    outline: Outline,
    kind: Parenchyma,
    skin_depth_mm: NDArray[np.float64],
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
    from_skin = (skin_depth_mm - fat) / 10.0
    behind = 5.0 + 2.5 * smooth_noise(rng, frame, 35.0)
    from_muscle = (-muscle_depth_mm - behind) / 7.0
    # The gland leans to the upper outer quadrant, where most of it is.
    lean = np.cos(np.arctan2(superior, lateral) - np.deg2rad(rng.normal(50.0, 15.0)))
    slant = np.rad2deg(np.arctan2(across, ahead))
    in_cone = (kind.cone_deg + kind.lean_deg * lean - slant) / 18.0
    limits = np.stack(np.broadcast_arrays(from_skin, from_muscle, in_cone, np.full_like(back, 1.3)))
    sharp = 2.5
    # Lobes fan out from the nipple; towards the chest wall they end one after the other.
    forward = AHEAD * (1.0 - distance / (AHEAD_SHARE * shape.depth_mm)).clip(-1.0, 1.0)
    least = forward - np.log(np.exp(-sharp * limits.clip(-6.0, 6.0)).sum(axis=0)) / sharp
    return np.clip(least, -3.0, None)


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
    return room + sleeve + lobes + gland_patches(room, kind, frame, rng)


def gland_patches(
    room: NDArray[np.float64], kind: Parenchyma, frame: VoxelFrame, rng: np.random.Generator
) -> NDArray[np.float64]:
    """What patches of gland and fat add to the potential."""
    patches = 0.7 * smooth_noise(rng, frame, 25.0) + 0.7 * smooth_noise(rng, frame, 13.0)
    # Patches fill the room that gland has; they hardly carry it into the fat beyond.
    held = np.where(patches > 0.0, np.clip(0.5 + 0.5 * room, 0.0, 1.0), 1.0)
    added: NDArray[np.float64] = kind.patchiness * held * patches
    return added

"""What is smooth in a breast, on a grid of 2 mm: where gland may be, warps, septa."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.shape import GRID_MM, Shape, mesh


@dataclass(frozen=True)
class Parenchyma:
    """How glandular tissue lies in a breast of a density class.

    Parameters
    ----------
    fat_mm : float
        Subcutaneous fat at the back of the breast, mm; it thins towards the nipple.
    cone_deg : float
        Half angle at the nipple of the cone that holds the gland, degrees.
    patchiness : float
        Amplitude of noise of 12 and 25 mm.
    strands : float
        Amplitude of noise that runs towards the nipple.
    lobules : float
        How strongly fat lobules push gland aside.
    """

    fat_mm: float
    cone_deg: float
    patchiness: float
    strands: float
    lobules: float


PARENCHYMA: MappingProxyType[str, Parenchyma] = MappingProxyType(
    {
        "fatty": Parenchyma(13.0, 40.0, 0.40, 0.55, 0.5),
        "scattered": Parenchyma(11.0, 46.0, 0.38, 0.55, 0.6),
        "heterogeneous": Parenchyma(8.5, 58.0, 0.33, 0.50, 0.7),
        "dense": Parenchyma(6.0, 70.0, 0.28, 0.42, 0.7),
    }
)
"""Chosen by eye on projections, so that each class looks like mammograms of its BI-RADS letter;
subcutaneous fat of 5 to 15 mm and a cone at the nipple follow anatomical drawings (Cooper 1840)."""

WARP_MM, WARP_WAVELENGTH_MM = 3.5, 28.0
"""Amplitude and wavelength of the bending of lobes and lobules, mm."""

LOBES = 16
"""Ducts open in the nipple, one a lobe: 15 to 20 in textbooks, mean 9 active ones by ultrasound
(Ramsay et al. 2005, J Anat 206:525-534) and over 15 in sections."""


def smooth_noise(
    rng: np.random.Generator, frame: VoxelFrame, wavelength_mm: float
) -> NDArray[np.float64]:
    """Noise of mean 0 and variance 1 without detail below a wavelength."""
    noise = ndimage.gaussian_filter(
        rng.standard_normal(frame.shape), wavelength_mm / (2.0 * np.pi) / GRID_MM, mode="wrap"
    )
    return (noise - noise.mean()) / noise.std()


def envelope(
    shape: Shape,
    kind: Parenchyma,
    skin_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Potential of glandular tissue without its fine structure: about 1 inside, falling outside.

    The least, smoothly taken, of what the skin, the chest wall and the cone at the nipple allow;
    then lobes of unequal strength, and patches.
    """
    x, lateral, superior = mesh(frame)
    ahead = shape.depth_mm + 4.0 - x
    across = np.hypot(lateral, superior)
    distance = np.hypot(ahead, across)
    back = np.clip(distance / (0.9 * shape.depth_mm), 0.0, 1.0)
    uneven = smooth_noise(rng, frame, 30.0)
    fat = 2.0 + (kind.fat_mm * np.clip(1.0 + 0.25 * uneven, 0.5, 1.6) - 2.0) * back**0.8
    from_skin = (skin_depth_mm - fat) / 7.0
    behind = 5.0 + 2.5 * smooth_noise(rng, frame, 35.0)
    from_muscle = (-muscle_depth_mm - behind) / 6.0
    # The gland leans to the upper outer quadrant, where most of it is.
    lean = np.cos(np.arctan2(superior, lateral) - np.deg2rad(50.0))
    slant = np.rad2deg(np.arctan2(across, ahead))
    in_cone = (kind.cone_deg + 9.0 * lean - slant) / 16.0
    limits = np.stack(np.broadcast_arrays(from_skin, from_muscle, in_cone, np.full_like(back, 1.2)))
    sharp = 3.0
    least = -np.log(np.exp(-sharp * limits.clip(-6.0, 6.0)).sum(axis=0)) / sharp
    patches = 0.7 * smooth_noise(rng, frame, 25.0) + 0.7 * smooth_noise(rng, frame, 13.0)
    lobes = _lobes(shape, frame, rng)
    return np.clip(least, -3.0, None) + kind.patchiness * patches + lobes


def _lobes(shape: Shape, frame: VoxelFrame, rng: np.random.Generator) -> NDArray[np.float64]:
    """Strength of each lobe, with a dip between neighbours; lobes are sectors at the nipple."""
    x, lateral, superior = mesh(frame)
    ahead = shape.depth_mm + 8.0 - x
    bend = 0.12
    u = lateral / np.maximum(ahead, 8.0) + bend * smooth_noise(rng, frame, 40.0)
    v = superior / np.maximum(ahead, 8.0) + bend * smooth_noise(rng, frame, 40.0)
    radius = np.sqrt((np.arange(LOBES) + 0.5) / LOBES) * 1.3
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(LOBES) + rng.uniform(0.0, 2.0 * np.pi)
    strength = 0.30 * rng.standard_normal(LOBES)
    first = np.full(u.shape, np.inf)
    second = np.full(u.shape, np.inf)
    value = np.zeros(u.shape)
    for lobe in range(LOBES):
        gap = np.hypot(
            u - radius[lobe] * np.cos(angle[lobe]), v - radius[lobe] * np.sin(angle[lobe])
        )
        nearer = gap < first
        second = np.where(nearer, first, np.minimum(second, gap))
        first = np.where(nearer, gap, first)
        value = np.where(nearer, strength[lobe], value)
    dip = 0.35 * np.exp(-(((second - first) / 0.10) ** 2))
    return ndimage.gaussian_filter(value, 1.0) - dip


def warps(frame: VoxelFrame, rng: np.random.Generator) -> list[NDArray[np.float64]]:
    """Three displacements by which structures are bent, mm."""
    return [WARP_MM * smooth_noise(rng, frame, WARP_WAVELENGTH_MM) for _ in range(3)]


def septum_mm(
    skin_depth_mm: NDArray[np.float64], frame: VoxelFrame, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Thickness of the fibrous walls between fat lobules, mm: 0 over most of them.

    Cooper's ligaments are sheets of some tenths of a millimetre that are complete near the skin,
    where they hang up the gland, and broken elsewhere.
    """
    gate = smooth_noise(rng, frame, 16.0) - 0.9 + 0.6 * np.exp(-skin_depth_mm.clip(0) / 10.0)
    thickness: NDArray[np.float64] = np.clip(0.7 * gate, 0.0, 0.7)
    return thickness

"""The scene that photons cross: breast, paddle, support, and the air around and below them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS
from mammosim.acquisition.monte_carlo._detection_kernels import Turn
from mammosim.acquisition.monte_carlo._flight_kernels import (
    DENSITY_STEPS,
    MIXTURE_BITS,
    MIXTURE_MASK,
    Space,
)
from mammosim.acquisition.monte_carlo._scene_kernels import Field, pack_voxels
from mammosim.geometry import Gantry
from mammosim.projection import CoarseBreast
from mammosim.tissues import Material

BEYOND_FIELD_MM = 40.0
"""How far paddle and support go on beyond the field, mm."""

MAX_MIXTURES = 60_000
"""Mixtures that 16 bits can number, with some to spare. Materials in quarters of a voxel, to which
shares are rounded beyond, make at most 2 x 3 876 (15 materials and air, in the beam or not)."""
_TABLE_BITS = 17
"""Places of the hash table of mixtures, as a power of two: at most half of them are taken."""


@dataclass(frozen=True)
class Plates:
    """Flat layers above and below the breast.

    Parameters
    ----------
    paddle, support : Material
    paddle_mm, support_mm : float
        Their thicknesses, mm; 0 for none.
    edge_mm : float
        Gantry x of their chest-wall edge, mm.
    """

    paddle: Material
    support: Material
    paddle_mm: float
    support_mm: float
    edge_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Cells with their mixtures.

    Parameters
    ----------
    space : Space
        Planes and words.
    materials : tuple of Material
        Of the breast, then of paddle and support, then air.
    fraction : ndarray of float64, [mixture, material]
        Volume fractions; they add up to one.
    tissue : ndarray of bool, [mixture]
        Mixtures of the breast, not of the plates.
    in_field : ndarray of bool, [mixture]
        Mixtures of voxels that the beam reaches.
    mass_g : ndarray of float64, [mixture, material]
        Mass of each material in all voxels of a mixture.
    inner : tuple of slice
        Where the breast's voxels are among the cells.
    """

    space: Space
    materials: tuple[Material, ...]
    fraction: NDArray[np.float64]
    tissue: NDArray[np.bool_]
    in_field: NDArray[np.bool_]
    mass_g: NDArray[np.float64]
    inner: tuple[slice, slice, slice]


def mixture_of(words: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Number of the mixture that each voxel holds.

    Parameters
    ----------
    words : ndarray of uint32
        Voxels as the transport kernels read them: the mixture's number in the low `MIXTURE_BITS`
        bits, the density in the others.

    Returns
    -------
    ndarray of uint32
        Same shape.

    Examples
    --------
    >>> word = np.array([(256 << MIXTURE_BITS) | 3], np.uint32)
    >>> int(mixture_of(word)[0])
    3
    """
    return words & MIXTURE_MASK


def density_of(words: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Density of each voxel over that of its mixture.

    Parameters
    ----------
    words : ndarray of uint32
        Voxels as the transport kernels read them; see `mixture_of`.

    Returns
    -------
    ndarray of float64
        Same shape; 1 where the voxel is full, in steps of 1 / `DENSITY_STEPS`.

    Examples
    --------
    >>> half = np.array([round(DENSITY_STEPS / 2) << MIXTURE_BITS], np.uint32)
    >>> float(density_of(half)[0])
    0.5
    """
    return (words >> MIXTURE_BITS) / DENSITY_STEPS


def make_scene(
    breast: CoarseBreast, plates: Plates, gantry: Gantry, materials: Mapping[str, Material]
) -> Scene:
    """Put a coarse breast between its plates.

    Parameters
    ----------
    breast : CoarseBreast
    plates : Plates
    gantry : Gantry
    materials : mapping of str to Material
        What the breast's materials are made of.

    Returns
    -------
    Scene

    Notes
    -----
    One large cell on each side of the breast's grid carries the plates on to `BEYOND_FIELD_MM`
    beyond the field; one below the support is the air gap down to the detector. The air above the
    paddle is not part of the scene.

    A breast with more than `MAX_MIXTURES` different mixtures is rounded by `in_quarters`.
    """
    breast_materials = (materials[name] for name in breast.materials)
    used = (*breast_materials, plates.paddle, plates.support, BEAM_MATERIALS["air"])
    below, above = 1 + int(plates.support_mm > 0.0), int(plates.paddle_mm > 0.0)
    planes = _planes(breast, plates, gantry)
    shape = tuple(plane.size - 1 for plane in planes)
    one = np.uint32(round(DENSITY_STEPS)) << MIXTURE_BITS
    words = np.full(shape, one, np.uint32)
    nx, ny, nz = breast.shares.shape
    inner = (slice(1, 1 + nx), slice(1, 1 + ny), slice(below, below + nz))
    keys = _pack(breast, gantry, words[inner])
    under = 0.5 * (planes[0][1:] + planes[0][:-1]) > plates.edge_mm
    if above:
        words[under, :, -1] = one | np.uint32(1)
    if below == 2:
        words[under, :, 1] = one | np.uint32(2)
    fraction = np.zeros((3 + keys.size, len(used)))
    fraction[1, -3] = fraction[2, -2] = 1.0
    for column in range(len(breast.materials)):
        shift = np.uint64(4 * column)
        fraction[3:, column] = ((keys >> shift) & np.uint64(15)) / 8.0
    fraction[:, -1] = 1.0 - fraction.sum(axis=1)
    tissue = np.arange(len(fraction)) >= 3
    in_field = np.concatenate([np.ones(3, bool), keys >> np.uint64(60) == 0])
    space = Space(*planes, words.reshape(-1))
    return Scene(
        space, used, fraction, tissue, in_field, _masses(words[inner], breast, fraction, used),
        inner,
    )  # fmt: skip


def _planes(
    breast: CoarseBreast, plates: Plates, gantry: Gantry
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Planes between cells along x, y and z, mm."""
    x, y, z = (
        breast.origin_mm[axis] + np.arange(size + 1) * breast.spacing_mm[axis]
        for axis, size in enumerate(breast.shares.shape)
    )
    far = BEYOND_FIELD_MM
    x = np.concatenate([[x[0] - far], x, [max(x[-1], gantry.x_max_mm) + far]])
    low, high = min(y[0], gantry.y_min_mm) - far, max(y[-1], gantry.y_max_mm) + far
    y = np.concatenate([[low], y, [high]])
    if plates.support_mm > 0.0:
        z = np.concatenate([[z[0] - plates.support_mm], z])
    z = np.concatenate([[-gantry.support_to_detector_mm], z])
    if plates.paddle_mm > 0.0:
        z = np.concatenate([z, [z[-1] + plates.paddle_mm]])
    return x, y, z


def _pack(breast: CoarseBreast, gantry: Gantry, words: NDArray[np.uint32]) -> NDArray[np.uint64]:
    """Write the breast's words; the key of each mixture, whose numbers begin at 3."""
    table = np.full(1 << _TABLE_BITS, np.iinfo(np.uint64).max, np.uint64)
    numbers = np.zeros(table.size, np.int64)
    keys = np.empty(MAX_MIXTURES, np.uint64)
    bounds = np.array([0.0, gantry.x_max_mm, gantry.y_min_mm, gantry.y_max_mm])
    field = Field(
        breast.origin_mm, breast.spacing_mm, gantry.focal_spot_above_detector_mm,
        -gantry.support_to_detector_mm, bounds, Turn(*gantry.detector_turn),
    )  # fmt: skip
    packed = np.empty(breast.shares.shape, np.uint32)
    found = pack_voxels(breast.shares, breast.density, field, 3, table, numbers, keys, packed)
    if found < 0:
        shares = in_quarters(breast.shares, len(breast.materials))
        table[:] = np.iinfo(np.uint64).max
        found = pack_voxels(shares, breast.density, field, 3, table, numbers, keys, packed)
    words[:] = packed
    return keys[:found].copy()


def in_quarters(shares: NDArray[np.uint64], materials: int) -> NDArray[np.uint64]:
    """Round the shares of voxels from eighths to quarters.

    Parameters
    ----------
    shares : ndarray of uint64, [x, y, z]
        Eighths of a voxel that each material fills, four bits each, as in `CoarseBreast`.
    materials : int
        Number of materials; what they leave is air, which is rounded like another material.

    Returns
    -------
    ndarray of uint64, [x, y, z]
        The same in even eighths.

    Notes
    -----
    Odd shares go up and down by an eighth in turn, starting with up in every other voxel, as on a
    chequerboard, so that neighbours make up for each other. A voxel of n odd shares moves n / 16 of
    its volume from some materials to others, at most half of it (eight materials of an eighth
    each). Its attenuation changes by at most n / 16 of the difference between its materials with
    most and with least; with two odd shares, the usual case, by an eighth of that.

    Examples
    --------
    >>> shares = np.array([[[3 | 5 << 4, 3 | 5 << 4]]], np.uint64)
    >>> [(int(share) & 15, int(share) >> 4) for share in in_quarters(shares, 2).ravel()]
    [(4, 4), (2, 6)]
    """
    rounded = np.empty_like(shares)
    j, k = np.arange(shares.shape[1])[:, None], np.arange(shares.shape[2])
    for i, plane in enumerate(shares):  # plane by plane, to save memory
        up = (i + j + k) % 2 == 0
        out = np.zeros(plane.shape, np.uint64)
        for column in range(materials):
            shift = np.uint64(4 * column)
            share = ((plane >> shift) & np.uint64(15)).astype(np.int64)
            odd = share % 2 == 1
            moved = share + np.where(odd, np.where(up, 1, -1), 0)
            up ^= odd
            out |= moved.astype(np.uint64) << shift
        rounded[i] = out
    return rounded


def _masses(
    words: NDArray[np.uint32],
    breast: CoarseBreast,
    fraction: NDArray[np.float64],
    materials: Sequence[Material],
) -> NDArray[np.float64]:
    """[mixture, material] mass in all voxels of a mixture, g."""
    number, density = mixture_of(words).ravel(), density_of(words).ravel()
    volume_cm3 = np.bincount(number, density, minlength=len(fraction)) * (
        np.prod(breast.spacing_mm) / 1000.0
    )
    per_cm3 = np.array([material.density_g_cm3 for material in materials])
    return volume_cm3[:, None] * fraction * per_cm3

"""Collisions of photons: what is absorbed, and energy and direction of what is scattered."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mammosim._jit import borrowing_kernel, inlined_kernel
from mammosim.acquisition.monte_carlo._flight_kernels import (
    DENSITY_STEPS,
    DEPOSITED,
    F32,
    F64,
    MIXTURE_MASK,
    Ray,
)


class Sections(NamedTuple):
    """Cross-sections. `attenuation` [energy, mixture] is for density 1 / 8192, 1/mm.

    `deposit` [energy, mixture] is the mean energy that a collision leaves where it happens, keV;
    of no mixture where no map is wanted.
    """

    energy_kev: F64
    attenuation: F32
    deposit: F32
    fraction: F32
    incoherent: F32
    coherent: F32
    incoherent_cosine: F32
    coherent_cosine: F32


@borrowing_kernel
def collide(
    analog: bool,
    sections: Sections,
    word: np.uint32,
    photon: tuple[float, int, float, float],
    ledger: F64,
) -> tuple[float, int, float]:
    """A collision in a voxel: weight and energy bin afterwards, and cosine of the angle.

    The weight is reduced by the part that is absorbed; in analog mode absorption is drawn, and the
    energy that stays entered into the ledger.
    """
    power, energy, u, v = photon
    mixture = word & MIXTURE_MASK
    materials = sections.fraction.shape[1]
    scattered = 0.0
    for m in range(materials):
        part = sections.fraction[mixture, m]
        scattered += part * (sections.incoherent[energy, m] + sections.coherent[energy, m])
    chance = scattered / (sections.attenuation[energy, mixture] * DENSITY_STEPS)
    if analog:
        if u >= chance:
            ledger[DEPOSITED] += power * sections.energy_kev[energy]
            return 0.0, energy, 1.0
        u /= chance
    else:
        power *= chance
    left = u * scattered
    material, coherent = materials - 1, False
    for m in range(materials):
        part = sections.fraction[mixture, m]
        width = part * sections.incoherent[energy, m]
        if left < width:
            left /= width
            material = m
            break
        left -= width
        width = part * sections.coherent[energy, m]
        if left < width:
            left /= width
            material, coherent = m, True
            break
        left -= width
    cosines = sections.coherent_cosine if coherent else sections.incoherent_cosine
    place = v * (cosines.shape[2] - 1)
    at = min(int(place), cosines.shape[2] - 2)
    low, high = cosines[energy, material, at], cosines[energy, material, at + 1]
    cosine = low + (place - at) * (high - low)
    after = energy
    if not coherent:
        after = _lowered(sections.energy_kev, energy, cosine, left)
        if analog:
            ledger[DEPOSITED] += power * (sections.energy_kev[energy] - sections.energy_kev[after])
    return power, after, cosine


@inlined_kernel
def _lowered(energies: F64, energy: int, cosine: float, u: float) -> int:
    """Energy bin after a Compton event: one of the two nearest, so that the mean is right."""
    kev = energies[energy]
    scattered = kev / (1.0 + kev / 510.999 * (1.0 - cosine))
    place = (scattered - energies[0]) / (energies[1] - energies[0])
    low = math.floor(place)
    return max(int(low) + int(u < place - low), 0)


@inlined_kernel
def turned(ray: Ray, cosine: float, azimuth: float) -> Ray:
    """The ray turned by an angle and an azimuth about its direction."""
    x, y, z, dx, dy, dz = ray
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    across, along = sine * math.cos(azimuth), sine * math.sin(azimuth)
    flat = math.sqrt(max(1.0 - dz * dz, 0.0))
    if flat > 1e-6:
        ex, ey = dx / flat, dy / flat
        nx = cosine * dx + across * ex * dz - along * ey
        ny = cosine * dy + across * ey * dz + along * ex
        nz = cosine * dz - across * flat
    else:
        nx, ny, nz = across, along, math.copysign(cosine, dz * cosine)
    norm = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return x, y, z, nx * norm, ny * norm, nz * norm

"""Slow twins of the photon transport's kernels, and simple scenes to follow photons through."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from mammosim.acquisition.attenuation import BEAM_MATERIALS
from mammosim.acquisition.monte_carlo import (
    Field,
    Plates,
    follow,
    image_field,
    make_scene,
    on_energies,
    photon_tables,
)
from mammosim.geometry import Gantry, View
from mammosim.projection import CoarseBreast
from mammosim.tissues import composition

MATERIALS = composition("hammerstein", "hydroxyapatite")


def philox(counter, key, rounds=10):
    """Philox 4x32 by the definition of Salmon et al. 2011, with Python's whole numbers."""
    a, b, c, d = counter
    k0, k1 = key
    for _ in range(rounds):
        first, second = 0xD2511F53 * a, 0xCD9E8D57 * c
        a, b, c, d = (
            (second >> 32) ^ b ^ k0, second & 0xFFFFFFFF,
            (first >> 32) ^ d ^ k1, first & 0xFFFFFFFF,
        )  # fmt: skip
        k0, k1 = (k0 + 0x9E3779B9) & 0xFFFFFFFF, (k1 + 0xBB67AE85) & 0xFFFFFFFF
    return a, b, c, d


def crossed_lengths(planes, start, direction):
    """Cells that a ray crosses and the length in each: all crossings of all planes, sorted."""
    ways = {0.0}
    for axis in range(3):
        if direction[axis] != 0.0:
            ways |= {(plane - start[axis]) / direction[axis] for plane in planes[axis]}
    ways = sorted(way for way in ways if way >= 0.0)
    cells = []
    for near, far in pairwise(ways):
        middle = [start[axis] + 0.5 * (near + far) * direction[axis] for axis in range(3)]
        place = [int(np.searchsorted(planes[axis], middle[axis])) - 1 for axis in range(3)]
        inside = all(0 <= place[axis] < len(planes[axis]) - 1 for axis in range(3))
        if inside and far > near:
            cells.append((tuple(place), far - near))
    return cells


def gantry(rows=60, columns=60, pixel_mm=1.0, gap_mm=15.0, **turned):
    """A small detector at the chest wall; `turned` has angles of tube and detector."""
    return Gantry(
        View("CC", "L"), 0.0, 0.0, 650.0, gap_mm, 0.0, pixel_mm, rows, columns,
        -0.5 * rows * pixel_mm, **turned,
    )  # fmt: skip


def block(size_mm, origin_mm, materials=("gland",), eighths=(8,), voxel_mm=1.0, density=1.0):
    """A block of one mixture, at the gantry place of its lowest corner."""
    counts = [max(round(size / voxel_mm), 1) for size in size_mm]
    word = sum(part << (4 * place) for place, part in enumerate(eighths))
    return CoarseBreast(
        np.array(origin_mm, float), np.array(size_mm) / counts, tuple(materials),
        np.full(counts, word, np.uint64), np.full(counts, density, np.float32),
    )  # fmt: skip


def plates(paddle_mm=0.0, support_mm=0.0):
    return Plates(
        BEAM_MATERIALS["polycarbonate"], BEAM_MATERIALS["carbon fibre"], paddle_mm, support_mm
    )


class Case:
    """Everything that `follow` wants, for one energy or a flat spectrum."""

    def __init__(self, breast, geometry=None, layers=None, energy_kev=(20.0,), detector=None):
        from mammosim.acquisition.detectors import find_detector

        self.gantry = geometry or gantry()
        self.scene = make_scene(breast, layers or plates(), self.gantry, MATERIALS)
        energy = np.array(energy_kev)
        self.tables = photon_tables(self.scene.materials, energy.min(), energy.max())
        self.spectrum = on_energies(energy, np.ones((1, energy.size)), self.tables)
        self.detector = detector or find_detector("ideal")
        self.field = image_field(self.gantry, 2)

    def follow(self, photons, seed=1, **keys):
        return follow(
            self.scene, self.tables, self.gantry, keys.pop("field", self.field), self.spectrum,
            self.detector, cell_mm=2.0, photons=photons, seed=seed, **keys,
        )  # fmt: skip

    def deposited_kev(self, tallies):
        """[batch] energy absorbed in everything, in expectation."""
        total = self.tables.total @ self.scene.fraction.T
        share = (self.tables.absorbed @ self.scene.fraction.T) / total
        return (tallies.collisions * self.tables.energy_kev[:, None] * share).sum(axis=(1, 2))


def pencil(x_mm, y_mm, width_mm=0.2):
    """A field that is one small square."""
    half = 0.5 * width_mm
    return Field(
        np.array([y_mm + half, y_mm - half]), np.array([x_mm - half, x_mm + half]), np.ones((1, 1))
    )


def electrons_that_scatter(energy_kev, cosine, density_g_cm3, mass_fraction):
    """Moles of electrons a gram that scatter by an angle, in the impulse approximation.

    The profiles of Biggs, Mendelsohn and Mann, integrated up to the largest momentum; carbon's
    four outer electrons are a Fermi gas, whose profile is a parabola.
    """
    import xraylib

    def largest_momentum(bound_kev):
        left, away = energy_kev - bound_kev, 1.0 - cosine
        squared = 2.0 * energy_kev * left * away + bound_kev**2
        lost = energy_kev * left * away - 510.999 * bound_kev
        return 137.036 * lost / (510.999 * math.sqrt(squared))

    def cumulated(profile, up_to):
        p = np.linspace(0.0, min(abs(up_to), 99.0), 200)
        half = np.trapezoid([profile(float(at)) for at in p], p)
        return 0.5 + math.copysign(half, up_to)

    total = 0.0
    for symbol, fraction in mass_fraction.items():
        number = xraylib.SymbolToAtomicNumber(symbol)
        moles = fraction / xraylib.AtomicWeight(number)
        for shell in range(4 if number < 11 else 0):
            try:
                electrons = xraylib.ElectronConfig(number, shell)
                bound = xraylib.EdgeEnergy(number, shell)
                xraylib.ComptonProfile_Partial(number, shell, 0.0)
            except ValueError:
                continue
            if symbol == "C" and shell > 0:
                continue

            def profile(p, number=number, shell=shell):
                return xraylib.ComptonProfile_Partial(number, shell, p)

            total += moles * electrons * cumulated(profile, largest_momentum(bound))
        if symbol == "C":
            density = 4.0 * moles * density_g_cm3 * 6.02214076e23 * 5.29177211e-9**3
            edge = (3.0 * math.pi**2 * density) ** (1.0 / 3.0)

            def gas(p, edge=edge):
                return 0.75 * max(edge**2 - p**2, 0.0) / edge**3

            total += 4.0 * moles * cumulated(gas, largest_momentum(0.0))
    return total


def single_scatter(case, centre_mm, volume_mm3, cells_mm, energy_kev):
    """Energy per mm2 that a point-like scatterer sends to points (x, y, z) of the detector.

    Thomson's and Klein and Nishina's cross-sections with form factors of xraylib and
    `electrons_that_scatter`, for a fluence of one photon per mm2 on the detector's plane;
    attenuation left out.
    """
    import xraylib

    spot = case.gantry.focal_spot_mm
    centre = np.array(centre_mm)
    towards = centre - spot
    near = np.linalg.norm(towards)
    axis = towards / near
    height = case.gantry.focal_spot_height_mm
    fluence = (height / near) ** 2  # photons per mm2 across the ray, for 1 at the plane's foot
    gland = MATERIALS["gland"]
    halves = np.linspace(1e-3, 1.0, 41)  # sin(theta / 2)
    electrons = [
        electrons_that_scatter(
            energy_kev, 1.0 - 2.0 * s**2, gland.density_g_cm3, gland.mass_fraction
        )
        for s in halves
    ]
    electrons_barn = 0.0794078  # classical electron radius squared, barn (CODATA)
    angle = np.radians(case.gantry.detector_angle_deg)
    down = -np.array([0.0, np.sin(angle), np.cos(angle)])
    image = np.zeros(cells_mm.shape[:-1])
    for place in np.ndindex(image.shape):
        away = cells_mm[place] - centre
        far = np.linalg.norm(away)
        cosine = float(away @ axis / far)
        ratio = 1.0 / (1.0 + energy_kev / 510.999 * (1.0 - cosine))
        q = energy_kev / 12.39842 * math.sqrt(0.5 * (1.0 - cosine))
        compton = 0.602214 * np.interp(math.sqrt(0.5 * (1.0 - cosine)), halves, electrons)
        rayleigh = 0.0
        for symbol, part in gland.mass_fraction.items():
            number = xraylib.SymbolToAtomicNumber(symbol)
            atoms = part / xraylib.AtomicWeight(number) * 0.602214  # 1e24 atoms a gram
            rayleigh += atoms * xraylib.FF_Rayl(number, q) ** 2
        kn = 0.5 * electrons_barn * ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
        thomson = 0.5 * electrons_barn * (1.0 + cosine**2)
        per_sr = (compton * kn * ratio + rayleigh * thomson) * energy_kev  # keV cm2/(g sr)
        grams = gland.density_g_cm3 * volume_mm3 * 1e-3
        solid = away @ down / far**3  # sr per mm2 of the detector's plane
        image[place] = fluence * per_sr * 100.0 * grams * solid
    return image

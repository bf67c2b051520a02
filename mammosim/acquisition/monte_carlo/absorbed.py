"""Energy and dose that the photons of an exposure leave in each material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.monte_carlo.scene import Scene, density_of, mixture_of
from mammosim.acquisition.monte_carlo.tables import PhotonTables
from mammosim.acquisition.monte_carlo.transport import Tallies
from mammosim.acquisition.spectrum import KEV_TO_MGY_G


@dataclass(frozen=True, eq=False)
class AbsorbedEnergy:
    """Energy absorbed in each material of a scene, for the fluence that was followed.

    Parameters
    ----------
    materials : tuple of str
    energy_kev : ndarray of float64, [batch, mixture, material]
        Absorbed energy, keV.
    mass_g : ndarray of float64, [mixture, material]
        Mass within the breast, g.
    in_field : ndarray of bool, [mixture]
    tissue : ndarray of bool, [mixture]
    """

    materials: tuple[str, ...]
    energy_kev: NDArray[np.float64]
    mass_g: NDArray[np.float64]
    in_field: NDArray[np.bool_]
    tissue: NDArray[np.bool_]

    def dose_mgy(self, material: str, *, in_field: bool = False) -> tuple[float, float]:
        """Mean absorbed dose of a material and its standard error, mGy; NaN where there is none.

        Parameters
        ----------
        material : str
        in_field : bool
            Whether only voxels that the beam reaches count.
        """
        if material not in self.materials:
            return float("nan"), float("nan")
        column = self.materials.index(material)
        counted = self.tissue & (self.in_field | (not in_field))
        mass = float(self.mass_g[counted, column].sum())
        if mass <= 0.0:
            return float("nan"), float("nan")
        by_batch = self.energy_kev[:, counted, column].sum(axis=1) * KEV_TO_MGY_G / mass
        error = float(by_batch.std(ddof=1) / np.sqrt(by_batch.size)) if by_batch.size > 1 else 0.0
        return float(by_batch.mean()), error


def absorbed_energy(tallies: Tallies, scene: Scene, tables: PhotonTables) -> AbsorbedEnergy:
    """Share collisions among the materials of each mixture.

    Parameters
    ----------
    tallies : Tallies
    scene : Scene
    tables : PhotonTables

    Notes
    -----
    Of the photons that collide in a mixture, ``f_m mu_m / sum f mu`` do so in material m, and leave
    there the part ``(tau + T sigma) / mu`` of their energy, T being the mean part that a Compton
    event takes away. Electrons stop where they are set free: their range is below 20 um.
    """
    total = tables.total @ scene.fraction.T  # [energy, mixture]
    per_collision = np.divide(
        tables.energy_kev[:, None], total, out=np.zeros_like(total), where=total > 0.0
    )
    weighted = tallies.collisions * per_collision
    energy = np.einsum("bex,em->bxm", weighted, tables.absorbed, optimize=True) * scene.fraction
    names = tuple(material.name for material in scene.materials)
    return AbsorbedEnergy(names, energy, scene.mass_g, scene.in_field, scene.tissue)


def dose_map_mgy(tallies: Tallies, scene: Scene) -> NDArray[np.float32]:
    """Absorbed dose of each voxel of the breast, [x, y, z], mGy; 0 in air.

    Parameters
    ----------
    tallies : Tallies
        Of photons that were followed with `mapped`.
    scene : Scene
    """
    assert tallies.energy_map is not None
    space = scene.space
    shape = tuple(plane.size - 1 for plane in (space.x, space.y, space.z))
    words = space.words.reshape(shape)[scene.inner]
    mixture = mixture_of(words)
    density = np.array([material.density_g_cm3 for material in scene.materials])
    volume_cm3 = np.diff(space.x)[1] * np.diff(space.y)[1] * np.diff(space.z)[scene.inner[2].start]
    mass_g = density_of(words) * (scene.fraction @ density)[mixture]
    mass_g *= volume_cm3 / 1000.0
    energy = tallies.energy_map.mean(axis=0).reshape(shape)[scene.inner]
    dose = energy * KEV_TO_MGY_G / mass_g
    return np.where(scene.tissue[mixture], dose, 0.0).astype(np.float32)

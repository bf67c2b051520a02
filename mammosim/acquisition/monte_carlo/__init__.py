"""Scatter and dose by Monte Carlo on a coarse copy of the compressed breast."""

from mammosim.acquisition.monte_carlo.absorbed import (
    AbsorbedEnergy,
    absorbed_energy,
    dose_map_mgy,
)
from mammosim.acquisition.monte_carlo.glandularity import core_glandularity_percent
from mammosim.acquisition.monte_carlo.grid import Grid
from mammosim.acquisition.monte_carlo.scene import (
    Plates,
    Scene,
    density_of,
    make_scene,
    mixture_of,
)
from mammosim.acquisition.monte_carlo.smoothing import Guide, smoothed, smoothed_scatter
from mammosim.acquisition.monte_carlo.tables import PhotonTables, photon_tables
from mammosim.acquisition.monte_carlo.transport import (
    Field,
    Tallies,
    follow,
    image_field,
    importance_of,
    on_energies,
    shadow_of,
)

__all__ = [
    "AbsorbedEnergy",
    "Field",
    "Grid",
    "Guide",
    "PhotonTables",
    "Plates",
    "Scene",
    "Tallies",
    "absorbed_energy",
    "core_glandularity_percent",
    "density_of",
    "dose_map_mgy",
    "follow",
    "image_field",
    "importance_of",
    "make_scene",
    "mixture_of",
    "on_energies",
    "photon_tables",
    "shadow_of",
    "smoothed",
    "smoothed_scatter",
]

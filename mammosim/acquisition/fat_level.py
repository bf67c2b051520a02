"""Attenuation of fat that fills the gap between the plates, which a scanner knows beforehand."""

from __future__ import annotations

import numpy as np

from mammosim.acquisition.attenuation import attenuation_per_mm
from mammosim.acquisition.contrast_agent import materials_of
from mammosim.acquisition.grid_parts import primary_part
from mammosim.acquisition.recording import DetectorInput

SKIN_MM = 2.9
"""Skin on both faces together; it is 1.45 mm thick on average (Huang et al. 2008, Med Phys
35:1199)."""


def fat_attenuation(incident: DetectorInput) -> float:
    """Attenuation of fat at full thickness under the beam and scatter of an image.

    Parameters
    ----------
    incident : DetectorInput

    Returns
    -------
    float
        ln(signal of air / signal) for a ray at right angles, with skin on both faces and the
        breast's usual share of scatter behind the grid.

    Notes
    -----
    The scatter-to-primary ratio of the whole breast is used; behind fat it is somewhat smaller,
    which raises the result by a few hundredths at most.
    """
    settings, unit = incident.settings, incident.unit
    materials = materials_of(settings)
    skin_mm = min(SKIN_MM, incident.paths.thickness_mm)
    depth = attenuation_per_mm(materials["skin"], unit.energy_kev) * skin_mm
    depth += attenuation_per_mm(materials["adipose"], unit.energy_kev) * (
        incident.paths.thickness_mm - skin_mm
    )
    weight = unit.energy_weight[0]
    primary = float(np.sum(weight * np.exp(-depth)) / np.sum(weight))
    scatter = incident.scatter_to_primary
    if settings.grid:
        scatter *= incident.scatter_part / primary_part(settings, unit)
    return -float(np.log(primary * (1.0 + scatter)))

"""Glandularity of the breast's core, as tables of dose mean it."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from mammosim.acquisition.coarse import NOT_PARENCHYMA
from mammosim.acquisition.monte_carlo.scene import Scene, density_of, mixture_of

SHELL_MM = 5.0  # of fat all around the mixture, except at the chest wall: Dance 1990


def core_glandularity_percent(scene: Scene) -> float:
    """Mass of all but fat over all mass, under the outer 5 mm of the breast in the beam, per cent.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    float
        NaN without a core.

    Notes
    -----
    The outer 5 mm are those above and below in each column of voxels, and those within 5 mm of
    the breast's outline seen along the compression; the chest wall's edge is no outline.
    """
    space, inner = scene.space, scene.inner
    shape = tuple(plane.size - 1 for plane in (space.x, space.y, space.z))
    words = space.words.reshape(shape)[inner]
    mixture = mixture_of(words)
    tissue = scene.tissue[mixture]
    step = np.diff(space.x)[1]
    outline = np.pad(tissue.any(axis=2), ((1, 1), (1, 1)))
    outline[0] = outline[1]  # the breast goes on behind the chest wall's edge
    depth = ndimage.distance_transform_edt(outline)[1:-1, 1:-1] * step - 0.5 * step
    z = 0.5 * (space.z[1:] + space.z[:-1])[inner[2]]
    low = np.where(tissue, space.z[:-1][inner[2]], np.inf).min(axis=2)
    high = np.where(tissue, space.z[1:][inner[2]], -np.inf).max(axis=2)
    under = (z > low[..., None] + SHELL_MM) & (z < high[..., None] - SHELL_MM)
    core = tissue & under & (depth > SHELL_MM)[..., None] & scene.in_field[mixture]
    number = mixture[core]
    density = density_of(words[core])
    amount = np.bincount(number, density, minlength=len(scene.fraction)) @ scene.fraction
    mass = {
        material.name: float(amount[column]) * material.density_g_cm3
        for column, material in enumerate(scene.materials[:-3])
        if material.name not in NOT_PARENCHYMA
    }
    whole = sum(mass.values())
    return 100.0 * (1.0 - mass.get("adipose", 0.0) / whole) if whole > 0.0 else float("nan")

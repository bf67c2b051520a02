"""Heel effect: fewer and harder photons towards the anode, which is on the nipple's side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.tube import ANODE_ANGLE_DEG, tube_fluence

# Tubes of 16 degrees are tilted by about 6, so that the field's chest-wall edge sees the anode at
# 22 degrees and its far edge still sees it (Bushberg et al., The Essential Physics of Medical
# Imaging, 3rd ed., ch. 8). The tube's axis then meets a detector at 650 mm 68 mm in front of
# the chest wall, next to the point where beams are measured (60 mm).
TUBE_TILT_DEG = 6.0
NODE_DEG = 2.0  # between these angles emission is taken to be linear in the angle
STEEPEST_DEG = ANODE_ANGLE_DEG - 0.5  # rays nearer to the anode's face get what this one has


def heel_ratio(
    target: str, kvp: float, energy_kev: NDArray[np.float64], tangent: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Photons in each direction over those along the tube's axis.

    Parameters
    ----------
    target : str
    kvp : float
    energy_kev : ndarray of float64, (n,)
    tangent : ndarray of float64, (columns,)
        Distance from the chest wall over that from the focal spot.

    Returns
    -------
    ndarray of float64, [column, energy]

    Notes
    -----
    SpekPy's spectra at the angle of each direction with the tube's axis; filters are crossed at
    right angles. The direction along the chest wall hardly matters and is left out.
    """
    towards_anode = np.degrees(np.arctan(tangent)) - TUBE_TILT_DEG
    nodes = np.append(np.arange(-TUBE_TILT_DEG, STEEPEST_DEG, NODE_DEG), STEEPEST_DEG)
    tube_energy, axis = tube_fluence(target, kvp)
    some = axis > 0.0
    at_nodes = [
        np.interp(
            energy_kev,
            tube_energy[some],
            tube_fluence(target, kvp, float(node))[1][some] / axis[some],
        )
        for node in nodes
    ]
    position = np.clip((towards_anode - nodes[0]) / NODE_DEG, 0.0, None)
    lower = np.minimum(position.astype(np.int64), nodes.size - 2)
    step = nodes[lower + 1] - nodes[lower]
    share = np.clip((towards_anode - nodes[lower]) / step, 0.0, 1.0)[:, None]
    table = np.array(at_nodes)
    ratio: NDArray[np.float64] = (1.0 - share) * table[lower] + share * table[lower + 1]
    return ratio

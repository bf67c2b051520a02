"""Heel effect: fewer and harder photons towards the anode, which is on the nipple's side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.tube import tube_fluence

# Tubes of 16 degrees are tilted by about 6, so that the field's chest-wall edge sees the anode at
# 22 degrees and its far edge still sees it (Bushberg et al., The Essential Physics of Medical
# Imaging, 3rd ed., ch. 8). The tube's axis then meets a detector at 650 mm 68 mm in front of
# the chest wall, next to the point where beams are measured (60 mm).
TUBE_TILT_DEG = 6.0
# Angles with the tube's axis, degrees, at which SpekPy is asked: close together near the anode's
# face (16 degrees), where emission falls fast; linear between them. Beyond the last it is held.
NODES_DEG = (-6.0, -3.0, 0.0, 3.0, 6.0, 8.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 15.5)


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
    tube_energy, axis = tube_fluence(target, kvp)
    some = axis > 0.0
    at_nodes = np.array([
        np.interp(
            energy_kev, tube_energy[some], tube_fluence(target, kvp, node)[1][some] / axis[some]
        )
        for node in NODES_DEG
    ])  # fmt: skip
    nodes = np.array(NODES_DEG)
    lower = np.clip(np.searchsorted(nodes, towards_anode) - 1, 0, nodes.size - 2)
    share = (towards_anode - nodes[lower]) / (nodes[lower + 1] - nodes[lower])
    share = np.clip(share, 0.0, 1.0)[:, None]
    ratio: NDArray[np.float64] = (1.0 - share) * at_nodes[lower] + share * at_nodes[lower + 1]
    return ratio

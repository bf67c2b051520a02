"""Distances from regions of a picture, and from the discs that fit into them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage


def distance_to(region: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each cell to a region, cells; infinite where there is none."""
    if not region.any():
        return np.full(region.shape, np.inf)
    distance: NDArray[np.float64] = ndimage.distance_transform_edt(~region)
    return distance


def beyond_discs(region: NDArray[np.bool_], radius: float) -> NDArray[np.float64]:
    """Distance of each cell to the discs that fit into a region, cells; up to 0 within them.

    What the array's border cuts off goes on beyond it; infinite where no disc fits.
    """
    return distance_to(ndimage.distance_transform_edt(region) > radius) - radius

"""Scatter models: name in a configuration -> function from a `ScatterCase` to the scatter signal.

A model returns a `Scatter`, whose signal is the mean scatter of each cell in front of the
anti-scatter grid, in the unit of the primary (keV/(pixel mAs)), [row, column], float64, not
negative. It changes nothing that it is given. Blur and noise come later and are not its business.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.acquisition.scatter.convolution import scatter_by_kernels
from mammosim.acquisition.scatter.photon_transport import (
    VOXEL_MM,
    follow_through,
    scatter_by_monte_carlo,
)
from mammosim.acquisition.scatter.scatter_case import DoseMap, Scatter, ScatterCase, ScatterDose


def no_scatter(case: ScatterCase) -> Scatter:
    """No scatter at all: the primary alone.

    Parameters
    ----------
    case : ScatterCase
        Primary signal and geometry of an exposure.

    Returns
    -------
    Scatter
        Zero in every cell, without a dose: that is then computed from Dance's factors.
    """
    return Scatter(np.zeros_like(case.primary))


SCATTER_MODELS: dict[str, Callable[[ScatterCase], Scatter]] = {
    "monte-carlo": scatter_by_monte_carlo,
    "kernels": scatter_by_kernels,
    "none": no_scatter,
}
"""Scatter models by the name that `acquisition.scatter.model` gives them."""

DEFAULT_SCATTER = "monte-carlo"
"""What ``scatter: true`` means."""

__all__ = [
    "DEFAULT_SCATTER",
    "SCATTER_MODELS",
    "VOXEL_MM",
    "DoseMap",
    "Scatter",
    "ScatterCase",
    "ScatterDose",
    "follow_through",
    "no_scatter",
    "scatter_by_kernels",
    "scatter_by_monte_carlo",
]

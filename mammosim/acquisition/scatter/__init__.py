"""Scatter models: name in a configuration -> function from a `ScatterCase` to the scatter signal.

A model returns the mean scatter signal of each cell in front of the anti-scatter grid, in the unit
of the primary (keV/(pixel mAs)), [row, column], float64, not negative. It changes nothing that it
is given. The grid, blur and noise come later and are not its business.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.scatter.convolution import scatter_by_kernels
from mammosim.acquisition.scatter.scatter_case import ScatterCase


def no_scatter(case: ScatterCase) -> NDArray[np.float64]:
    """No scatter at all: the primary alone."""
    return np.zeros_like(case.primary)


SCATTER_MODELS: dict[str, Callable[[ScatterCase], NDArray[np.float64]]] = {
    "kernels": scatter_by_kernels,
    "none": no_scatter,
}
"""Scatter models by the name that `acquisition.scatter.model` gives them."""

DEFAULT_SCATTER = "kernels"
"""What ``scatter: true`` means."""

__all__ = ["DEFAULT_SCATTER", "SCATTER_MODELS", "ScatterCase", "no_scatter", "scatter_by_kernels"]

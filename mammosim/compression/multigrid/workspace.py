"""Arrays that many short steps share."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.floating]


class Workspace:
    """Arrays that hierarchies of one lattice share, since only one of them works at a time.

    `eigenvalues` holds the levels' largest of hierarchies that are much alike, by what they share.
    """

    def __init__(self) -> None:
        self.eigenvalues: dict[Hashable, list[float]] = {}
        self._arrays: dict[tuple[str, tuple[int, ...]], Field] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Field:
        """The array of a name and shape; zero where nothing has written."""
        if (name, shape) not in self._arrays:
            self._arrays[name, shape] = np.zeros(shape, np.float32)
        return self._arrays[name, shape]

"""What a scatter model is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.spectrum import Beam
from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.tissues import Material


@dataclass(frozen=True, eq=False)
class ScatterCase:
    """An exposure as a scatter model sees it, on a grid of square cells of pixels.

    Parameters
    ----------
    primary : ndarray of float64, [row, column]
        Mean primary signal of the pixels of each cell, in front of the grid, keV/(pixel mAs).
    thickness_mm : ndarray of float64, [row, column]
        Mean path through all tissue, mm.
    cell : int
        Pixels along the side of a cell. Cells at the last row and column may be cut by the edge.
    gantry : Gantry
        Focal spot, support, detector and pixels.
    beam : Beam
        Photons as they leave the paddle; `layers_mm` says what they have crossed.
    detector : Detector
        What absorbs them.
    support_mm : float
        Carbon fibre of breast support and detector cover, mm.
    materials : mapping of str to Material
        Composition and density of each material of the tissue table.
    breast : CompressedBreast or None
        The voxels; None where only path lengths are known.
    """

    primary: NDArray[np.float64]
    thickness_mm: NDArray[np.float64]
    cell: int
    gantry: Gantry
    beam: Beam
    detector: Detector
    support_mm: float
    materials: Mapping[str, Material]
    breast: CompressedBreast | None = None

    @property
    def cell_mm(self) -> float:
        """Side of a cell on the detector, mm."""
        return self.cell * self.gantry.pixel_mm

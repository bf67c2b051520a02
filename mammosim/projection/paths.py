"""Path lengths: how much of each tissue lies on the ray to each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry


@dataclass(frozen=True, eq=False)
class PathLengths:
    """Lengths of each tissue along the ray to each pixel.

    Tissues of one material are one channel; each lesion has its own channel, whose length is
    the exact truth of where it appears.

    Parameters
    ----------
    tissues : tuple of str
        Name of each channel: a material of the tissue table, or the name of a lesion.
    materials : tuple of str
        Material that each channel attenuates as.
    lesion_labels : tuple of int
        Label of the lesion that each channel is, 0 where it is none.
    length_mm : ndarray of float32, [tissue, row, column]
        Geometric length, mm.
    attenuating_mm : ndarray of float32, [tissue, row, column]
        The same weighted by the density that compression leaves (1/J) and a lesion's fill, mm,
        the steps of voxels larger than a pixel smoothed.
        It is `length_mm` itself where mass is not conserved.
    gantry : Gantry
        Pixels, focal spot and detector.
    thickness_mm : float
        Gap between the plates' faces, mm.
    force_n : float
        Force on the paddle, N.
    clipped_fraction : float
        Fraction of the tissue volume whose 1/J was clipped to 0.5-2.
    breast : CompressedBreast or None
        What was projected, for scatter models that trace photons through voxels; None in path
        lengths that were loaded from a file.
    notes : tuple of str
        Warnings, one sentence each.
    """

    tissues: tuple[str, ...]
    materials: tuple[str, ...]
    lesion_labels: tuple[int, ...]
    length_mm: NDArray[np.float32]
    attenuating_mm: NDArray[np.float32]
    gantry: Gantry
    thickness_mm: float
    force_n: float
    clipped_fraction: float
    breast: CompressedBreast | None = None
    notes: tuple[str, ...] = ()

    @property
    def pixel_mm(self) -> float:
        """Pixel pitch, mm."""
        return self.gantry.pixel_mm

    def __repr__(self) -> str:
        channels, rows, columns = self.length_mm.shape
        return (
            f"<PathLengths {self.gantry.view.folder}: {channels} tissues, {rows} x {columns} "
            f"pixels of {self.pixel_mm:g} mm>"
        )

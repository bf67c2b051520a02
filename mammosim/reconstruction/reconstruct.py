"""From a tomosynthesis series to slices: `reconstruct`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Tomosynthesis
from mammosim.geometry import Gantry
from mammosim.reconstruction.rtk import load_rtk, reconstruct_by_rtk
from mammosim.reconstruction.settings import ReconstructionSettings
from mammosim.reconstruction.volume import VolumeGrid, volume_grid

BYTES_PER_VOXEL = {"fdk": 8, "sart": 24}
"""Volumes in single precision that RTK holds at once: input and output of FDK; SART's volume, its
correction, the normalization, and their copies. Measured."""

BYTES_PER_PROJECTED_PIXEL = {"fdk": 12, "sart": 12}
"""Line integrals, and the copies that RTK makes of a few projections at a time."""


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Slices of a compressed breast.

    Parameters
    ----------
    slices : ndarray of float32, [slice, row, column]
        Attenuation coefficient, 1/mm; of `fdk`, relative to its neighbourhood only.
    grid : VolumeGrid
        Where the voxels are.
    settings : ReconstructionSettings
    """

    slices: NDArray[np.float32]
    grid: VolumeGrid
    settings: ReconstructionSettings


def reconstruct(
    series: Tomosynthesis, settings: ReconstructionSettings | None = None
) -> Reconstruction:
    """Reconstruct slices parallel to the detector from a series of projections.

    Parameters
    ----------
    series : Tomosynthesis
    settings : ReconstructionSettings, optional

    Returns
    -------
    Reconstruction

    Raises
    ------
    InputError
        If itk-rtk is not installed.

    Notes
    -----
    By RTK, the Reconstruction Toolkit (Rit et al. 2014, J Phys Conf Ser 489:012079). `fdk` is
    Feldkamp, Davis and Kress' filtered back-projection (1984, J Opt Soc Am A 1:612) with a ramp
    along the tube's movement; an arc leaves out most spatial frequencies, so that its values are
    relative. `sart` is Andersen and Kak's (1984, Ultrason Imaging 6:81). Neither removes scatter or
    beam hardening. Slices start at the breast support; what lies between the plates' edge and the
    detector's is reconstructed as air and tissue mixed.
    """
    settings = settings or ReconstructionSettings()
    load_rtk()
    grid = volume_grid(
        series.middle.gantry, series.middle.thickness_mm, settings.slice_mm, settings.pixel_mm
    )
    volume = reconstruct_by_rtk(_line_integrals(series), series.gantries, grid, settings)
    return Reconstruction(np.ascontiguousarray(volume.transpose(0, 2, 1)), grid, settings)


def reconstruction_gb(gantry: Gantry, count: int, grid: VolumeGrid, method: str) -> float:
    """Memory that a reconstruction takes at its peak, GB."""
    pixels = count * gantry.rows * gantry.columns
    needed = BYTES_PER_VOXEL[method] * grid.voxels + BYTES_PER_PROJECTED_PIXEL[method] * pixels
    return 1e-9 * needed


def _line_integrals(series: Tomosynthesis) -> NDArray[np.float32]:
    """[projection, column, row], as RTK takes them."""
    count, rows, columns = series.projections.shape
    stack = np.empty((count, columns, rows), np.float32)
    for index in range(count):
        stack[index] = series.attenuation(index).T
    return stack

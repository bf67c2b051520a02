"""From a tomosynthesis series to slices: `reconstruct`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Tomosynthesis
from mammosim.config import documents_keys, given_settings
from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.projection import installed_memory
from mammosim.reconstruction.keys import ReconstructionKeys
from mammosim.reconstruction.rtk import load_rtk, reconstruct_by_rtk
from mammosim.reconstruction.settings import ReconstructionSettings
from mammosim.reconstruction.synthetic import Synthetic, synthetic_mammogram
from mammosim.reconstruction.volume import Box, VolumeGrid, box_above, volume_grid

BYTES_PER_VOXEL = {"fdk": 16, "sart": 12}
"""Volumes in single precision that are held at once: RTK's zeros and result of `fdk`, the one
volume of `sart`, and the result's two copies, the second in the order of the slices."""

BYTES_PER_PROJECTED_PIXEL = {"fdk": 12, "sart": 5}
"""Line integrals, and copies of all projections, or of one of them."""

SECONDS_PER_UPDATE = {"fdk": 9e-9, "sart": 20e-9}
"""Of one voxel by one projection on two cores; measured 17 and 38 ns of processor time, with
filters and projectors, on 52 million voxels."""

SHOWN_QUANTILES = (0.01, 0.9995)
"""Of the values in the breast, what is shown black and what white."""

TISSUE_SHARE = 0.3
"""Voxels above this share of the 99th percentile are taken for tissue. Assumed; fat has 0.5 or more
of gland's attenuation."""


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Slices of a compressed breast.

    Parameters
    ----------
    slices : ndarray of float32, [slice, row, column]
        Attenuation coefficient, 1/mm; of `fdk`, relative to its neighbourhood only.
    grid : VolumeGrid
        Where the voxels are.
    gantry : Gantry
        Of the projection nearest to the upright tube; it places the volume in the breast.
    settings : ReconstructionSettings
    synthetic : Synthetic or None
        The picture made of the slices, where `synthetic_2d` asks for one.
    """

    slices: NDArray[np.float32]
    grid: VolumeGrid
    gantry: Gantry
    settings: ReconstructionSettings
    synthetic: Synthetic | None = None

    @property
    def shown_range(self) -> tuple[float, float]:
        """Attenuation coefficients that are shown black and white, 1/mm.

        They are taken from every eighth row and column of the middle half of the slices; of `sart`,
        whose air is nearly 0, from what is tissue.
        """
        count = self.slices.shape[0]
        sample = self.slices[count // 4 : max(count // 4 + 1, 3 * count // 4), ::8, ::8]
        inside = sample[sample > TISSUE_SHARE * np.quantile(sample, 0.99)]
        if self.settings.method == "fdk" or inside.size == 0:
            inside = sample
        low, high = (float(value) for value in np.quantile(inside, SHOWN_QUANTILES))
        return low, max(high, low + 1e-6)


@documents_keys(ReconstructionSettings, ReconstructionKeys)
def reconstruct(
    series: Tomosynthesis,
    settings: ReconstructionSettings | None = None,
    **keys: Unpack[ReconstructionKeys],
) -> Reconstruction:
    """Reconstruct slices parallel to the detector from a series of projections.

    Parameters
    ----------
    series : Tomosynthesis
    settings : ReconstructionSettings, optional
        Method and voxels; or give its keys as keywords.
    **keys
        Keys of `ReconstructionSettings`: ``method``, ``slice_mm``, ``iterations``, ...

    Returns
    -------
    Reconstruction

    Raises
    ------
    InputError
        If a key is unknown or its value cannot be used, itk-rtk is not installed, or the volume
        does not fit in memory.

    Notes
    -----
    By RTK, the Reconstruction Toolkit (Rit et al. 2014, J Phys Conf Ser 489:012079). `fdk` is
    Feldkamp, Davis and Kress' filtered back-projection (1984, J Opt Soc Am A 1:612) with a ramp
    along the tube's movement; an arc leaves out most spatial frequencies, so that its values are
    relative. `sart` is Andersen and Kak's (1984, Ultrason Imaging 6:81). Neither removes scatter or
    beam hardening. Slices start at the breast support; what lies between the plates' edge and the
    detector's is reconstructed as air and tissue mixed. Only the part of the detector that the
    breast's shadow meets is used, and only what lies straight above it is reconstructed.
    """
    settings = given_settings(ReconstructionSettings, settings, keys, "reconstruct()")
    gantry, thickness_mm = series.middle.gantry, series.middle.thickness_mm
    middle = series.gantries.index(gantry)
    box = box_above(gantry, Box(*map(int, series.shadows[middle])), thickness_mm)
    grid = volume_grid(gantry, thickness_mm, settings.slice_mm, settings.pixel_mm, box)
    used = _all_shadows(series)
    check_reconstruction(len(series.gantries) * used.rows * used.columns, grid.voxels, settings)
    volume = reconstruct_by_rtk(
        _line_integrals(series, used), series.gantries, used, grid, settings
    )
    slices = np.ascontiguousarray(volume.transpose(0, 2, 1))
    del volume
    synthetic = None
    if settings.synthetic_2d:
        synthetic = synthetic_mammogram(slices, grid.slice_mm, grid.pixel_mm)
    return Reconstruction(slices, grid, gantry, settings, synthetic)


def check_reconstruction(pixels: int, voxels: int, settings: ReconstructionSettings) -> None:
    """Refuse a reconstruction that cannot be made on this machine.

    Parameters
    ----------
    pixels : int
        Of all projections together, as far as they are used.
    voxels : int
    settings : ReconstructionSettings

    Raises
    ------
    InputError
        If itk-rtk is not installed, or with the memory that is needed and the memory that is
        there.
    """
    load_rtk()
    needed, there = reconstruction_gb(pixels, voxels, settings.method), 1e-9 * installed_memory()
    if needed > there:
        raise InputError(
            f"dbt.reconstruct: found slices of {settings.slice_mm:g} mm"
            + (f" with pixels of {settings.pixel_mm:g} mm" if settings.pixel_mm else "")
            + f", {voxels / 1e6:.0f} million voxels, which need {needed:.1f} GB; this machine has "
            f"{there:.1f} GB: use larger slice_mm or pixel_mm"
        )


def reconstruction_gb(pixels: int, voxels: int, method: str) -> float:
    """Memory that a reconstruction takes at its peak, GB.

    Parameters
    ----------
    pixels : int
        Of all projections together.
    voxels : int
    method : {"fdk", "sart"}
    """
    needed = BYTES_PER_VOXEL[method] * voxels + BYTES_PER_PROJECTED_PIXEL[method] * pixels
    return 1e-9 * needed


def reconstruction_seconds(
    projections: int, voxels: int, settings: ReconstructionSettings
) -> float:
    """About how long a reconstruction takes on two cores.

    Parameters
    ----------
    projections : int
    voxels : int
        Of the volume that is reconstructed.
    settings : ReconstructionSettings

    Returns
    -------
    float
        Seconds: a measured time of one voxel by one projection, times both numbers and, for `sart`,
        the iterations.

    Examples
    --------
    >>> from mammosim.reconstruction import ReconstructionSettings
    >>> round(reconstruction_seconds(25, 50_000_000, ReconstructionSettings(method="sart")))
    25
    """
    passes = settings.iterations if settings.method == "sart" else 1
    return SECONDS_PER_UPDATE[settings.method] * projections * voxels * passes


def _all_shadows(series: Tomosynthesis) -> Box:
    """The part of the detector that holds the breast's shadow in every projection."""
    gantry = series.middle.gantry
    cast = series.shadows[series.shadows[:, 1] > 0]
    if cast.size == 0:
        return Box(0, gantry.rows, 0, gantry.columns)
    low, high = cast.min(axis=0), cast.max(axis=0)
    return Box(int(low[0]), int(high[1]), int(low[2]), int(high[3]))


def _line_integrals(series: Tomosynthesis, box: Box) -> NDArray[np.float32]:
    """[projection, column, row] of a part of the detector, as RTK takes them."""
    part = np.s_[box.first_row : box.end_row, box.first_column : box.end_column]
    stack = np.empty((len(series.gantries), box.columns, box.rows), np.float32)
    for index, picture in enumerate(stack):
        picture[:] = series.attenuation(index)[part].T
    return stack

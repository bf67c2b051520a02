"""Reconstruction by RTK, the Reconstruction Toolkit: the one place that imports it.

RTK turns a gantry about its y axis. Here its x axis runs along the picture's rows (the direction in
which the tube moves), its y axis along the columns (from the chest wall or towards it) and its z
axis up from the breast support, so that the ramp filter works along the tube's movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.reconstruction.settings import ReconstructionSettings
from mammosim.reconstruction.volume import VolumeGrid

INSTALL = 'pip install "mammosim[dbt]"'
"""What to type where the library is missing."""


def load_rtk() -> tuple[Any, Any]:
    """The modules `itk` and `itk.RTK`.

    Raises
    ------
    InputError
        If the library is not installed.
    """
    try:
        import itk
        from itk import RTK
    except ImportError as error:
        raise InputError(
            f"dbt.reconstruct: itk-rtk cannot be imported ({error}); install it with: {INSTALL}"
        ) from None
    return itk, RTK


def reconstruct_by_rtk(
    attenuation: NDArray[np.float32],
    gantries: Sequence[Gantry],
    grid: VolumeGrid,
    settings: ReconstructionSettings,
) -> NDArray[np.float32]:
    """Reconstruct a volume.

    Parameters
    ----------
    attenuation : ndarray of float32, [projection, column, row]
        Line integrals of the attenuation coefficient; no unit. It is scaled in place by `fdk`.
    gantries : sequence of Gantry
        One a projection.
    grid : VolumeGrid
    settings : ReconstructionSettings

    Returns
    -------
    ndarray of float32, [slice, column, row]
        Attenuation coefficient, 1/mm. Note the order of the axes: it is RTK's.
    """
    itk, rtk = load_rtk()
    geometry = _geometry(itk, rtk, gantries, grid)
    stack = _projections(itk, attenuation, gantries[0])
    source = _empty_volume(itk, rtk, grid)
    if settings.method == "fdk":
        attenuation *= _angular_weights(gantries)[:, None, None]
        solver = rtk.FDKConeBeamReconstructionFilter[type(stack)].New()
        solver.GetRampFilter().SetHannCutFrequency(settings.hann)
    else:
        kind = type(stack)
        solver = rtk.SARTConeBeamReconstructionFilter[kind, kind].New()
        solver.SetNumberOfIterations(settings.iterations)
        solver.SetLambda(settings.relaxation)
        solver.SetEnforcePositivity(True)
    solver.SetInput(0, source.GetOutput())
    solver.SetInput(1, stack)
    solver.SetGeometry(geometry)
    solver.Update()
    volume: NDArray[np.float32] = itk.array_from_image(solver.GetOutput())
    return volume


def _in_rtk(point_mm: NDArray[np.float64], grid: VolumeGrid) -> NDArray[np.float64]:
    """A gantry point in RTK's frame, whose origin is the volume's centre, mm."""
    place = grid.voxel_of(point_mm) - 0.5 * (np.array(grid.shape) - 1.0)
    step = np.array([grid.slice_mm, grid.pixel_mm, grid.pixel_mm])
    slices, rows, columns = place * step
    return np.array([rows, columns, slices])


def _geometry(itk: Any, rtk: Any, gantries: Sequence[Gantry], grid: VolumeGrid) -> Any:
    geometry = rtk.ThreeDCircularProjectionGeometry.New()
    for gantry in gantries:
        spot = _in_rtk(gantry.focal_spot_mm, grid)
        corner = _in_rtk(_pixel_mm(gantry, 0, 0), grid)
        added = geometry.AddProjection(
            _point(itk, spot), _point(itk, corner), _vector(itk, (1, 0, 0)), _vector(itk, (0, 1, 0))
        )
        if not added:
            raise InputError(
                f"dbt: found a tube angle of {gantry.tube_angle_deg:g} degrees, expected one from "
                "which the focal spot is above the detector"
            )
    return geometry


def _pixel_mm(gantry: Gantry, row: int, column: int) -> NDArray[np.float64]:
    """Centre of a detector pixel in the gantry frame, mm."""
    return np.append(gantry.detector_xy_mm(row, column), -gantry.support_to_detector_mm)


def _projections(itk: Any, attenuation: NDArray[np.float32], gantry: Gantry) -> Any:
    """The stack as RTK sees it: pixel [0, 0] is at the corner that `_geometry` gives."""
    image = itk.image_view_from_array(attenuation)
    image.SetSpacing((gantry.pixel_mm, gantry.pixel_mm, 1.0))
    image.SetOrigin((0.0, 0.0, 0.0))
    return image


def _empty_volume(itk: Any, rtk: Any, grid: VolumeGrid) -> Any:
    slices, rows, columns = grid.shape
    kind = itk.Image[itk.F, 3]
    source = rtk.ConstantImageSource[kind].New()
    source.SetSize((rows, columns, slices))
    source.SetSpacing((grid.pixel_mm, grid.pixel_mm, grid.slice_mm))
    source.SetOrigin(
        (
            -0.5 * (rows - 1) * grid.pixel_mm,
            -0.5 * (columns - 1) * grid.pixel_mm,
            -0.5 * (slices - 1) * grid.slice_mm,
        )
    )
    source.SetConstant(0.0)
    return source


def _angular_weights(gantries: Sequence[Gantry]) -> NDArray[np.float32]:
    """Correction of RTK's weights of each projection in `fdk`.

    RTK gives a projection half of the angle between its neighbours on a full circle, so that the
    first and the last of an arc are also given the part of the circle that was not measured. Here
    they are given the step to their one neighbour.
    """
    angle = np.radians([gantry.tube_angle_deg for gantry in gantries])
    if len(angle) == 1:
        return np.ones(1, np.float32)
    order = np.argsort(angle)
    gap = np.diff(angle[order], append=angle[order[0]] + 2.0 * np.pi)
    given = 0.5 * (gap + np.roll(gap, 1))
    inner = gap[:-1]
    wanted = 0.5 * (np.append(inner, inner[-1]) + np.insert(inner, 0, inner[0]))
    weights = np.empty(len(angle), np.float32)
    weights[order] = wanted / given
    return weights


def _point(itk: Any, place: NDArray[np.float64]) -> Any:
    point = itk.Point[itk.D, 3]()
    for axis in range(3):
        point[axis] = float(place[axis])
    return point


def _vector(itk: Any, direction: tuple[int, int, int]) -> Any:
    vector = itk.Vector[itk.D, 3]()
    for axis in range(3):
        vector[axis] = float(direction[axis])
    return vector

"""Reconstruction by RTK, the Reconstruction Toolkit: the one place that imports it.

RTK turns a gantry about its y axis. Here its x axis runs along the picture's rows (the direction in
which the tube moves), its y axis along the columns (from the chest wall or towards it) and its z
axis up from the breast support, so that the ramp filter works along the tube's movement.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import gcd
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.reconstruction.settings import ReconstructionSettings
from mammosim.reconstruction.volume import Box, VolumeGrid

AIR_SLICES = 1
"""Slices of air below the first and above the last: RTK's ray caster ends at the centres of the
outermost slices, which would count by half."""

SIDE_COLUMNS = 1
"""Columns and rows beside the volume: for the same reason rays to the outermost pixels, which lean
towards the tube, would miss the outermost column, and the next would be too bright to make up for
it: a line along the chest wall."""

INSTALL = "pip install itk-rtk"
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
    box: Box,
    grid: VolumeGrid,
    settings: ReconstructionSettings,
) -> NDArray[np.float32]:
    """Reconstruct a volume.

    Parameters
    ----------
    attenuation : ndarray of float32, [projection, column, row]
        Line integrals of the attenuation coefficient; no unit. It is overwritten by `fdk`.
    gantries : sequence of Gantry
        One a projection.
    box : Box
        Pixels of the detector that the line integrals are of.
    grid : VolumeGrid
    settings : ReconstructionSettings

    Returns
    -------
    ndarray of float32, [slice, column, row]
        Attenuation coefficient, 1/mm. Note the order of the axes: it is RTK's.
    """
    if settings.method == "fdk":
        return _filtered_back_projection(attenuation, gantries, box, grid, settings)
    return _simultaneous_algebraic(attenuation, gantries, box, grid, settings)


def _filtered_back_projection(
    attenuation: NDArray[np.float32],
    gantries: Sequence[Gantry],
    box: Box,
    grid: VolumeGrid,
    settings: ReconstructionSettings,
) -> NDArray[np.float32]:
    """RTK weights and projects back; the ramp is ours, as its own takes most of the time."""
    itk, rtk = load_rtk()
    kind = itk.Image[itk.F, 3]
    geometry = _geometry(itk, rtk, gantries, box, grid)
    attenuation *= _angular_weights(gantries)[:, None, None]
    weigh = rtk.FDKWeightProjectionFilter[kind].New()
    weigh.SetInput(_projections(itk, attenuation, gantries[0]))
    weigh.SetGeometry(geometry)
    weigh.InPlaceOff()
    weigh.Update()
    weighted = itk.array_view_from_image(weigh.GetOutput())
    for picture, weighed in zip(attenuation, weighted, strict=True):
        picture[:] = ramp_filtered(weighed, gantries[0].pixel_mm, settings.hann)
    project_back = rtk.FDKBackProjectionImageFilter[kind, kind].New()
    source = _empty_volume(itk, rtk, grid)  # a source that Python forgets has no pixels
    project_back.SetInput(0, source.GetOutput())
    project_back.SetInput(1, _projections(itk, attenuation, gantries[0]))
    project_back.SetGeometry(geometry)
    project_back.Update()
    volume: NDArray[np.float32] = itk.array_from_image(project_back.GetOutput())
    return volume


def _simultaneous_algebraic(
    attenuation: NDArray[np.float32],
    gantries: Sequence[Gantry],
    box: Box,
    grid: VolumeGrid,
    settings: ReconstructionSettings,
) -> NDArray[np.float32]:
    """Andersen and Kak's technique, one projection after the other, by RTK's two projectors.

    For each: the difference between what was measured and what the volume would give, over the
    ray's length in the volume, is projected back. RTK's own loop goes through the whole volume six
    times more for each projection. The order of projections is one that keeps successive angles
    far apart, as is usual.
    """
    itk, rtk = load_rtk()
    source = _empty_volume(itk, rtk, grid, AIR_SLICES, SIDE_COLUMNS)
    source.Update()
    volume = source.GetOutput()
    volume.DisconnectPipeline()
    for _ in range(settings.iterations):
        for index in scattered_order(len(gantries)):
            measured, gantry = attenuation[index : index + 1], gantries[index]
            geometry = _geometry(itk, rtk, [gantry], box, grid)
            difference = measured - _through(itk, rtk, volume, measured.shape, gantry, geometry)
            path_mm = _lengths_mm(itk, rtk, volume, measured.shape, gantry, geometry)
            met = path_mm > 0.0
            difference[met] *= np.float32(settings.relaxation) / path_mm[met]
            difference[~met] = 0.0
            volume = _added(itk, rtk, volume, difference, gantry, geometry)
            array = itk.array_view_from_image(volume)
            array[:AIR_SLICES] = array[-AIR_SLICES:] = 0.0
        np.maximum(array, 0.0, out=array)
    beside = slice(SIDE_COLUMNS, -SIDE_COLUMNS)
    result: NDArray[np.float32] = itk.array_from_image(volume)[
        AIR_SLICES:-AIR_SLICES, beside, beside
    ]
    return result


# ITK does not keep an array alive that it was given: each is held by a name until it is done.


def _through(
    itk: Any, rtk: Any, volume: Any, shape: tuple[int, ...], gantry: Gantry, geometry: Any
) -> NDArray[np.float32]:
    """Line integrals of a volume, [1, column, row]."""
    kind, empty = itk.Image[itk.F, 3], np.zeros(shape, np.float32)
    project = rtk.JosephForwardProjectionImageFilter[kind, kind].New()
    project.SetInput(0, _projections(itk, empty, gantry))
    project.SetInput(1, volume)
    project.SetGeometry(geometry)
    project.Update()
    line_integrals: NDArray[np.float32] = itk.array_from_image(project.GetOutput())
    return line_integrals


def _lengths_mm(
    itk: Any, rtk: Any, volume: Any, shape: tuple[int, ...], gantry: Gantry, geometry: Any
) -> NDArray[np.float32]:
    """Length of each ray within a volume, [1, column, row]."""
    kind, empty = itk.Image[itk.F, 3], np.zeros(shape, np.float32)
    length = rtk.RayBoxIntersectionImageFilter[kind, kind].New()
    length.SetInput(_projections(itk, empty, gantry))
    length.SetGeometry(geometry)
    length.SetBoxFromImage(volume, False)
    length.Update()
    lengths_mm: NDArray[np.float32] = itk.array_from_image(length.GetOutput())
    return lengths_mm


def _added(
    itk: Any, rtk: Any, volume: Any, picture: NDArray[np.float32], gantry: Gantry, geometry: Any
) -> Any:
    """The volume, to which a picture [1, column, row] is projected back, in its own memory."""
    kind = itk.Image[itk.F, 3]
    project_back = rtk.BackProjectionImageFilter[kind, kind].New()
    project_back.SetInput(0, volume)
    project_back.SetInput(1, _projections(itk, picture, gantry))
    project_back.SetGeometry(geometry)
    project_back.InPlaceOn()
    project_back.Update()
    added = project_back.GetOutput()
    added.DisconnectPipeline()
    return added


def scattered_order(count: int) -> list[int]:
    """Numbers below `count`, each far from those before it: by steps near the golden section.

    Examples
    --------
    >>> scattered_order(5)
    [0, 3, 1, 4, 2]
    """
    step = next(n for n in range(max(1, round(0.618 * count)), count + 2) if gcd(n, count) == 1)
    return [index * step % count for index in range(count)]


def ramp_filtered(
    picture: NDArray[np.float32], pixel_mm: float, hann: float
) -> NDArray[np.float32]:
    """Ramp filter along the last axis, with a Hann window.

    Parameters
    ----------
    picture : ndarray of float32, [column, row]
    pixel_mm : float
        Distance between samples, mm.
    hann : float
        Cut-off of the window, share of the Nyquist frequency; 0 for none.

    Returns
    -------
    ndarray of float32
        Of the picture's unit over mm.

    Notes
    -----
    The ramp's samples in space are Kak and Slaney's (1988, Principles of computerized tomographic
    imaging, eq. 3.61), so that the mean of what is cut off is not lost.
    """
    count = picture.shape[-1]
    size = fft.next_fast_len(2 * count, real=True)
    step = np.minimum(np.arange(size), size - np.arange(size))
    ramp = np.zeros(size)
    ramp[0] = 0.25
    odd = step % 2 == 1
    ramp[odd] = -1.0 / (np.pi * step[odd]) ** 2
    response = fft.rfft(ramp).real / pixel_mm
    if hann > 0.0:
        frequency = np.arange(response.size) / (0.5 * size)  # of the Nyquist frequency
        window = 0.5 * (1.0 + np.cos(np.pi * frequency / hann))
        response *= np.where(frequency <= hann, window, 0.0)
    spectrum = fft.rfft(picture, size, axis=-1) * response.astype(np.float32)
    filtered: NDArray[np.float32] = fft.irfft(spectrum, size, axis=-1)[..., :count]
    return filtered


def _in_rtk(point_mm: NDArray[np.float64], grid: VolumeGrid) -> NDArray[np.float64]:
    """A gantry point in RTK's frame, whose origin is the volume's centre, mm."""
    place = grid.voxel_of(point_mm) - 0.5 * (np.array(grid.shape) - 1.0)
    step = np.array([grid.slice_mm, grid.pixel_mm, grid.pixel_mm])
    slices, rows, columns = place * step
    return np.array([rows, columns, slices])


def _geometry(itk: Any, rtk: Any, gantries: Sequence[Gantry], box: Box, grid: VolumeGrid) -> Any:
    geometry = rtk.ThreeDCircularProjectionGeometry.New()
    for gantry in gantries:
        spot = _in_rtk(gantry.focal_spot_mm, grid)
        corner, down, right = (
            _in_rtk(gantry.detector_mm(box.first_row + row, box.first_column + column), grid)
            for row, column in ((0, 0), (1, 0), (0, 1))
        )
        # Rounded, so that a detector that lies flat does so for RTK too.
        along_rows, along_columns = (
            np.round(way / gantry.pixel_mm, 9) for way in (down - corner, right - corner)
        )
        added = geometry.AddProjection(
            _point(itk, spot), _point(itk, corner), _vector(itk, along_rows),
            _vector(itk, along_columns),
        )  # fmt: skip
        if not added:
            raise InputError(
                f"dbt: found a tube angle of {gantry.tube_angle_deg:g} degrees, expected one from "
                "which the focal spot is above the detector"
            )
    return geometry


def _projections(itk: Any, attenuation: NDArray[np.float32], gantry: Gantry) -> Any:
    """The stack as RTK sees it: pixel [0, 0] is at the corner that `_geometry` gives."""
    image = itk.image_view_from_array(attenuation)
    image.SetSpacing((gantry.pixel_mm, gantry.pixel_mm, 1.0))
    image.SetOrigin((0.0, 0.0, 0.0))
    return image


def _empty_volume(
    itk: Any, rtk: Any, grid: VolumeGrid, more_slices: int = 0, more_columns: int = 0
) -> Any:
    """Zeros, with some slices more below and above the grid's, and rows and columns beside it."""
    slices, rows, columns = grid.shape
    slices += 2 * more_slices
    rows, columns = rows + 2 * more_columns, columns + 2 * more_columns
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


def _vector(itk: Any, direction: NDArray[np.float64]) -> Any:
    vector = itk.Vector[itk.D, 3]()
    for axis in range(3):
        vector[axis] = float(direction[axis])
    return vector

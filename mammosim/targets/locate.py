"""From pixels back to the uncompressed breast: along one ray, or where two pictures meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mammosim.compression import DisplacementField
from mammosim.errors import InputError
from mammosim.geometry import Gantry, VoxelFrame

RAY_STEP_MM = 0.5
"""Distance along z at which a ray is looked through for tissue, mm: half the usual lattice."""

SMALLEST_ANGLE_DEG = 1.0
"""Between two rays of one compression: below it a pixel's error becomes tens of pixels of depth."""

ROUNDING_PX = 1e-6
"""By which a pixel may lie beyond the picture's edge and still count as on it."""


@dataclass(frozen=True, eq=False)
class ImagePoint:
    """A pixel at which something is seen in one picture.

    Parameters
    ----------
    name : str
        For messages, as `CC`.
    field : DisplacementField
        Compression under which the picture was taken.
    gantry : Gantry
    row, column : float
        Whole numbers at pixel centres, from 0.
    labels : ndarray of uint8, [x, y, z], optional
        Labels of the compressed breast, axes of the compression frame. Without them the lattice
        says where tissue is, to half its spacing.
    labels_frame : VoxelFrame, optional
        Where they are, compression frame, mm.
    """

    name: str
    field: DisplacementField
    gantry: Gantry
    row: float
    column: float
    labels: NDArray[np.uint8] | None = None
    labels_frame: VoxelFrame | None = None

    @property
    def what(self) -> str:
        """The pixel in words."""
        return f"{self.name}, pixel {self.row:g} {self.column:g}"

    def ray_mm(self, height_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) points of the ray at heights (n,) above the support, gantry frame, mm."""
        gantry, spot = self.gantry, self.gantry.focal_spot_mm
        pixel = gantry.detector_mm(self.row, self.column)
        share = (spot[2] - height_mm) / (spot[2] - pixel[2])
        points: NDArray[np.float64] = spot + share[:, None] * (pixel - spot)
        return points

    def misfit_mm(self, point_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(2,) distance along rows and columns, on the detector, of an uncompressed point's image
        from the pixel, mm."""
        place = point_mm + self.field.displacement_at(point_mm)[0]
        image = self.gantry.project(self.gantry.gantry_from_breast(place))
        return (image - [self.row, self.column]) * self.gantry.pixel_mm


@dataclass(frozen=True, eq=False)
class RayCurve:
    """The part of a ray that runs in the breast, and the curve it was before compression.

    Parameters
    ----------
    height_mm : ndarray, (n,)
        Height above the breast support, mm, rising.
    point_mm : ndarray, (n, 3)
        Uncompressed place, breast frame, mm.
    """

    height_mm: NDArray[np.float64]
    point_mm: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Located:
    """A point of the uncompressed breast.

    Parameters
    ----------
    point_mm : ndarray, (3,)
        Breast frame, mm.
    misfit_mm : tuple of float
        Distance on the detector, mm, of its image from the pixel in each picture.
    height_mm : tuple of float
        Height above the support, compressed, in each picture, mm.
    """

    point_mm: NDArray[np.float64]
    misfit_mm: tuple[float, ...]
    height_mm: tuple[float, ...]


def curve_of(image_point: ImagePoint, step_mm: float = RAY_STEP_MM) -> RayCurve:
    """The points of the uncompressed breast that one pixel may show.

    Parameters
    ----------
    image_point : ImagePoint
    step_mm : float
        Distance of the points along z, mm.

    Raises
    ------
    InputError
        If the pixel is not on the picture or its ray passes no breast.

    Notes
    -----
    Both ends of the ray's part in tissue belong to the curve, to half a millimetre. Where breast
    lies behind air behind breast, as in a fold, the curve has a gap.
    """
    _check_on_picture(image_point)
    fine = _along(image_point, RAY_STEP_MM)
    if step_mm <= RAY_STEP_MM:
        return fine
    low, high = fine.height_mm[[0, -1]]
    between = _along(image_point, step_mm, allow_none=True)
    inner = (between.height_mm > low) & (between.height_mm < high)
    return RayCurve(
        np.concatenate([[low], between.height_mm[inner], [high]]),
        np.concatenate([fine.point_mm[:1], between.point_mm[inner], fine.point_mm[-1:]]),
    )


def _along(image_point: ImagePoint, step_mm: float, allow_none: bool = False) -> RayCurve:
    """Points of a ray in tissue, at heights that are whole multiples of a step."""
    low, high = _heights_mm(image_point)
    height = step_mm * np.arange(np.ceil(low / step_mm), np.floor(high / step_mm) + 1.0)
    points = _original(image_point, height)
    inside = _in_tissue(image_point, height, points)
    if not (inside.any() or allow_none):
        raise InputError(f"{image_point.what}: lies outside the breast; no tissue is on its ray")
    return RayCurve(height[inside], points[inside])


def point_at_height(image_point: ImagePoint, height_mm: float) -> Located:
    """The point of the uncompressed breast that a pixel shows, its height being known.

    Parameters
    ----------
    image_point : ImagePoint
    height_mm : float
        Above the breast support, mm.

    Raises
    ------
    InputError
        If the pixel is outside the breast, or no breast is at that height on its ray.
    """
    curve = curve_of(image_point)
    height = np.array([height_mm], dtype=float)
    point = _original(image_point, height)
    if not _in_tissue(image_point, height, point)[0]:
        raise InputError(
            f"{image_point.what}: height_mm: found {height_mm:g}, which is in air; on this ray the "
            f"breast lies between {curve.height_mm[0]:.1f} and {curve.height_mm[-1]:.1f} mm above "
            "the support"
        )
    return _located(point[0], [image_point])


def point_from_image_points(image_points: Sequence[ImagePoint]) -> Located:
    """The point of the uncompressed breast that two or more pictures show.

    Parameters
    ----------
    image_points : sequence of ImagePoint
        Of different views, or of one compression under different tube angles (a stereotactic
        pair).

    Returns
    -------
    Located
        The point whose images are nearest to the pixels, least squares on the detectors.

    Raises
    ------
    InputError
        If a pixel is outside the breast, or two rays are too nearly one to meet in a point.
    """
    curves = [curve_of(image_point) for image_point in image_points]
    _check_angles(image_points)
    first, second = curves[0].point_mm, curves[1].point_mm
    apart = np.linalg.norm(first[:, None] - second[None], axis=-1)
    one, other = np.unravel_index(int(apart.argmin()), apart.shape)
    start = 0.5 * (first[one] + second[other])
    found = least_squares(
        lambda point: np.concatenate([seen.misfit_mm(point) for seen in image_points]),
        start, xtol=1e-10, ftol=1e-12, gtol=1e-12, diff_step=1e-5, x_scale=10.0,
    )  # fmt: skip
    return _located(found.x, image_points)


def stereotactic(gantry: Gantry, tube_angle_deg: float) -> Gantry:
    """The same gantry with its tube turned for a stereotactic view.

    Parameters
    ----------
    gantry : Gantry
    tube_angle_deg : float
        As `Gantry.tube_angle_deg`: about the pivot, positive towards +y; between -60 and 60.

    Returns
    -------
    Gantry
        Breast and detector stay where they are.

    Raises
    ------
    InputError
        If the angle is not in that range.
    """
    if not abs(tube_angle_deg) < 60.0:
        raise InputError(
            f"tube_angle_deg: found {tube_angle_deg:g}, expected degrees between -60 and 60"
        )
    return replace(gantry, tube_angle_deg=tube_angle_deg)


def _check_on_picture(image_point: ImagePoint) -> None:
    gantry, edge = image_point.gantry, 0.5 + ROUNDING_PX
    for name, value, count in (
        ("row", image_point.row, gantry.rows),
        ("column", image_point.column, gantry.columns),
    ):
        if not -edge <= value <= count - 1 + edge:
            raise InputError(
                f"{image_point.what}: the {name} is not on the image, which has {count}; "
                f"expected 0 to {count - 1}"
            )


def _check_angles(image_points: Sequence[ImagePoint]) -> None:
    """Refuse rays through one compression that are nearly parallel."""
    ends = np.array([0.0, 1.0])
    for number, image_point in enumerate(image_points):
        for other in image_points[:number]:
            if other.field is not image_point.field:
                continue
            one, two = (np.diff(each.ray_mm(ends), axis=0)[0] for each in (image_point, other))
            cosine = one @ two / np.linalg.norm(one) / np.linalg.norm(two)
            angle = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
            if angle < SMALLEST_ANGLE_DEG:
                raise InputError(
                    f"{other.what} and {image_point.what}: their rays differ by "
                    f"{angle:.2f} degrees, "
                    f"expected at least {SMALLEST_ANGLE_DEG:g}; give another view or tube angle"
                )


def _heights_mm(image_point: ImagePoint) -> tuple[float, float]:
    """Lowest and highest point of what may be breast above the support, mm."""
    frame = (
        image_point.field.inverse.frame
        if image_point.labels_frame is None
        else image_point.labels_frame
    )
    low = float(frame.origin_mm[2] - 0.5 * frame.spacing_mm[2])
    high = low + float(frame.shape[2] * frame.spacing_mm[2])
    return low - image_point.gantry.support_z_mm, high - image_point.gantry.support_z_mm


def _original(image_point: ImagePoint, height_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) uncompressed points of the ray at heights, breast frame; NaN where nothing was."""
    compressed = image_point.gantry.breast_from_gantry(image_point.ray_mm(height_mm))
    return image_point.field.original_point(compressed)


def _in_tissue(
    image_point: ImagePoint, height_mm: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which points of a ray are in tissue."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    field = image_point.field
    if image_point.labels is not None and image_point.labels_frame is not None:
        ray = image_point.gantry.breast_from_gantry(image_point.ray_mm(height_mm))
        compressed = image_point.gantry.view.compression_from_breast(ray)
        return known & _at(image_point.labels, image_point.labels_frame, compressed)
    at_rest = image_point.gantry.view.compression_from_breast(np.where(known[:, None], points, 0.0))
    return known & _at(field.tissue, field.frame, at_rest)


def _at(
    mask: NDArray[np.uint8] | NDArray[np.bool_], frame: VoxelFrame, points: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """(n,) whether the mask is set at points (n, 3); false outside it."""
    index = np.rint(frame.index(points)).astype(np.intp)
    inside = np.asarray(((index >= 0) & (index < mask.shape)).all(axis=1))
    index[~inside] = 0
    found: NDArray[np.bool_] = inside & (mask[index[:, 0], index[:, 1], index[:, 2]] > 0)
    return found


def _located(point: NDArray[np.float64], image_points: Sequence[ImagePoint]) -> Located:
    places = [point + image_point.field.displacement_at(point)[0] for image_point in image_points]
    return Located(
        point,
        tuple(float(np.linalg.norm(image_point.misfit_mm(point))) for image_point in image_points),
        tuple(
            float(image_point.gantry.gantry_from_breast(place)[2])
            for image_point, place in zip(image_points, places, strict=True)
        ),
    )

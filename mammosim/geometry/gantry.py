"""The gantry frame: focal spot, breast support, detector and its pixels.

x runs from the chest-wall edge of the detector towards the nipple, y along that edge (the
compression frame's y), z up from the upper surface of the breast support. All views are seen from
the tube; a right breast's picture is turned by 180 degrees against a left one's, never mirrored.

In tomosynthesis the tube turns about a pivot, an axis along x above the detector. The detector
stays where it is, or turns about the same axis by a smaller angle. Its *detector frame* is the
gantry frame turned with it: there the detector lies flat, at the height of an unturned one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.geometry.views import View

MAGNIFIED = 1.3
"""Magnification from which a view is a magnified one: contact views have 1.02 to 1.1, stands of
clinical units 1.5 to 2. Between them, assumed."""


def magnification(source_to_detector_mm: float, support_to_detector_mm: float) -> float:
    """How many times larger an object on the breast support appears on the detector.

    Parameters
    ----------
    source_to_detector_mm, support_to_detector_mm : float
        Heights of focal spot and breast support above the detector's plane, mm.

    Returns
    -------
    float
        S / (S - h); infinite where the focal spot is not above the support. Tissue higher in the
        breast is magnified more.

    Examples
    --------
    >>> round(magnification(650.0, 285.0), 2)
    1.78
    """
    above_mm = source_to_detector_mm - support_to_detector_mm
    return source_to_detector_mm / above_mm if above_mm > 0.0 else math.inf


class DetectorTurn(NamedTuple):
    """From gantry to detector frame: x stays, ``v = cosine y - sine z + y_mm`` and
    ``w = sine y + cosine z + z_mm``."""

    cosine: float
    sine: float
    y_mm: float
    z_mm: float


@dataclass(frozen=True)
class Gantry:
    """Where tube, support and detector are for one view.

    Parameters
    ----------
    view : View
        View and side.
    detector_edge_mm : float
        Breast-frame x of the detector's chest-wall edge (gantry x = 0), mm.
    support_z_mm : float
        Compression-frame z of the breast support's upper surface (gantry z = 0), mm.
    source_to_detector_mm : float
        Distance of the focal spot from the detector plane with the tube upright, mm.
    support_to_detector_mm : float
        Gap between the support's upper surface and the detector plane, mm.
    focal_spot_y_mm : float
        Compression-frame y of the focal spot with the tube upright, mm.
    pixel_mm : float
        Pixel pitch, mm.
    rows, columns : int
        Size of the image.
    y_min_mm : float
        Compression-frame y of the detector's lower edge, mm; the upper one is at
        ``y_min_mm + rows * pixel_mm``.
    tube_angle_deg : float
        Angle by which the tube is turned about the pivot, degrees; positive towards +y.
    pivot_to_detector_mm : float
        Height of the pivot above the detector plane, mm; it is above `focal_spot_y_mm`.
    detector_angle_deg : float
        Angle by which the detector is turned about the pivot, degrees, in the tube's sense.
    """

    view: View
    detector_edge_mm: float
    support_z_mm: float
    source_to_detector_mm: float
    support_to_detector_mm: float
    focal_spot_y_mm: float
    pixel_mm: float
    rows: int
    columns: int
    y_min_mm: float
    tube_angle_deg: float = 0.0
    pivot_to_detector_mm: float = 0.0
    detector_angle_deg: float = 0.0

    @property
    def y_max_mm(self) -> float:
        """Compression-frame y of the detector's upper edge, mm."""
        return self.y_min_mm + self.rows * self.pixel_mm

    @property
    def x_max_mm(self) -> float:
        """Gantry x of the detector's edge away from the chest wall, mm."""
        return self.columns * self.pixel_mm

    @property
    def origin_mm(self) -> NDArray[np.float64]:
        """(3,) origin of the gantry frame in the compression frame, mm."""
        return np.array([self.detector_edge_mm, 0.0, self.support_z_mm])

    @property
    def magnification(self) -> float:
        """How many times larger an object on the breast support appears on the detector."""
        return magnification(self.source_to_detector_mm, self.support_to_detector_mm)

    @property
    def focal_spot_mm(self) -> NDArray[np.float64]:
        """(3,) focal spot in the gantry frame, mm."""
        return self._focal_spot_at(self.tube_angle_deg)

    @property
    def focal_spot_above_detector_mm(self) -> NDArray[np.float64]:
        """(3,) focal spot in the detector frame, mm."""
        return self._focal_spot_at(self.tube_angle_deg - self.detector_angle_deg)

    @property
    def focal_spot_height_mm(self) -> float:
        """Distance of the focal spot from the detector's plane, mm."""
        return self._height_at(self.tube_angle_deg - self.detector_angle_deg)

    def _focal_spot_at(self, angle_deg: float) -> NDArray[np.float64]:
        arm = self.source_to_detector_mm - self.pivot_to_detector_mm
        y = self.focal_spot_y_mm + arm * math.sin(math.radians(angle_deg))
        return np.array([0.0, y, self._height_at(angle_deg) - self.support_to_detector_mm])

    def _height_at(self, angle_deg: float) -> float:
        arm = self.source_to_detector_mm - self.pivot_to_detector_mm
        fall = arm * (1.0 - math.cos(math.radians(angle_deg)))
        return self.source_to_detector_mm - fall

    @property
    def detector_turn(self) -> DetectorTurn:
        """How the detector frame is turned against the gantry frame."""
        angle = math.radians(self.detector_angle_deg)
        cosine, sine = math.cos(angle), math.sin(angle)
        y, z = self.focal_spot_y_mm, self.pivot_to_detector_mm - self.support_to_detector_mm
        return DetectorTurn(cosine, sine, y - (cosine * y - sine * z), z - (sine * y + cosine * z))

    def gantry_from_breast(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Breast-frame points (..., 3) to the gantry frame, mm."""
        return self.view.compression_from_breast(points_mm) - self.origin_mm

    def breast_from_gantry(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Gantry points (..., 3) to the breast frame, mm."""
        return self.view.breast_from_compression(np.asarray(points_mm) + self.origin_mm)

    def project(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Project gantry points through the focal spot onto the detector.

        Parameters
        ----------
        points_mm : array_like, (..., 3)
            Points below the focal spot, gantry frame, mm.

        Returns
        -------
        ndarray, (..., 2)
            Row and column, whole numbers at pixel centres.
        """
        points = self.detector_from_gantry(points_mm)
        spot = self.focal_spot_above_detector_mm
        scale = self.focal_spot_height_mm / (spot[2] - points[..., 2])
        x = spot[0] + (points[..., 0] - spot[0]) * scale
        y = spot[1] + (points[..., 1] - spot[1]) * scale
        return self.pixel_of(x, y)

    def detector_from_gantry(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Gantry points (..., 3) to the detector frame, mm."""
        points, turn = np.asarray(points_mm, dtype=np.float64), self.detector_turn
        x, y, z = (points[..., axis] for axis in range(3))
        v = turn.cosine * y - turn.sine * z + turn.y_mm
        return np.stack([x, v, turn.sine * y + turn.cosine * z + turn.z_mm], axis=-1)

    def gantry_from_detector(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Detector-frame points (..., 3) to the gantry frame, mm."""
        points, turn = np.asarray(points_mm, dtype=np.float64), self.detector_turn
        v, w = points[..., 1] - turn.y_mm, points[..., 2] - turn.z_mm
        y, z = turn.cosine * v + turn.sine * w, turn.cosine * w - turn.sine * v
        return np.stack([points[..., 0], y, z], axis=-1)

    def detector_mm(self, row: ArrayLike, column: ArrayLike) -> NDArray[np.float64]:
        """(..., 3) gantry points of rows and columns, mm."""
        flat = self.detector_xy_mm(row, column)
        plane = np.full((*flat.shape[:-1], 1), -self.support_to_detector_mm)
        return self.gantry_from_detector(np.concatenate([flat, plane], axis=-1))

    def pixel_of(self, x_mm: ArrayLike, y_mm: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) row and column of places on the detector, x and y of its own frame, mm."""
        x, y = np.asarray(x_mm, dtype=np.float64), np.asarray(y_mm, dtype=np.float64)
        if self.view.laterality == "L":
            row, column = (self.y_max_mm - y) / self.pixel_mm, x / self.pixel_mm
        else:
            row, column = (y - self.y_min_mm) / self.pixel_mm, (self.x_max_mm - x) / self.pixel_mm
        return np.stack([row - 0.5, column - 0.5], axis=-1)

    def detector_xy_mm(self, row: ArrayLike, column: ArrayLike) -> NDArray[np.float64]:
        """(..., 2) x and y of rows and columns in the detector frame, mm."""
        down, along = np.broadcast_arrays(
            (np.asarray(row, dtype=np.float64) + 0.5) * self.pixel_mm,
            (np.asarray(column, dtype=np.float64) + 0.5) * self.pixel_mm,
        )
        if self.view.laterality == "L":
            return np.stack([along, self.y_max_mm - down], axis=-1)
        return np.stack([self.x_max_mm - along, self.y_min_mm + down], axis=-1)

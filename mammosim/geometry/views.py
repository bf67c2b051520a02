"""Mammographic views: name, side, angle, and the rotation that belongs to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError
from mammosim.geometry.frames import compression_from_breast

VIEW_NAMES = ("CC", "MLO", "ML")


@dataclass(frozen=True)
class View:
    """One view of one breast.

    Parameters
    ----------
    name : {"CC", "MLO", "ML"}
    laterality : {"L", "R"}
    mlo_angle_deg : float
        Angle of the plates' normal from superior towards medial in MLO, degrees, 30 to 60.
    tomosynthesis : bool
        Whether it is taken as a series of projections.
    in_compression_frame : bool
        Whether the phantom's axes are those of the compression frame already, as of a breast that
        was compressed before: then nothing is turned, whatever the view.
    title : str
        What the run calls it in place of its name, as `CC_spot`; empty where it has no such name.
    spot : bool
        Whether a small paddle presses a part of the breast only.
    """

    name: str
    laterality: str
    mlo_angle_deg: float = 45.0
    tomosynthesis: bool = False
    in_compression_frame: bool = False
    title: str = ""
    spot: bool = False

    def __post_init__(self) -> None:
        if self.name not in VIEW_NAMES:
            raise InputError(f"view: found '{self.name}', expected one of {', '.join(VIEW_NAMES)}")
        if self.laterality not in ("L", "R"):
            raise InputError(f"laterality: found '{self.laterality}', expected L or R")

    @property
    def angle_deg(self) -> float:
        """Angle of the plates' normal from superior towards medial, degrees."""
        return {"CC": 0.0, "MLO": self.mlo_angle_deg, "ML": 90.0}[self.name]

    @property
    def label(self) -> str:
        """What a run calls the view: its title or name, as `CC`; of a series `CC_DBT`."""
        return (self.title or self.name) + ("_DBT" if self.tomosynthesis else "")

    @property
    def folder(self) -> str:
        """Name of the view's folder: laterality and label, as `LCC`."""
        return self.laterality + self.label

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) matrix from the phantom's frame to the compression frame.

        The phantom's is the breast frame, or the compression frame where it says so.
        """
        return np.eye(3) if self.in_compression_frame else self.patient_rotation

    @property
    def patient_rotation(self) -> NDArray[np.float64]:
        """(3, 3) matrix from the breast frame, which lies along the patient's axes, to the
        compression frame."""
        return compression_from_breast(self.angle_deg, self.laterality)

    def compression_from_breast(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Turn vectors or points (..., 3) of the breast frame into the compression frame.

        Both frames have the same origin, so that points turn as vectors do. Lengths keep their
        unit.

        Examples
        --------
        >>> View("ML", "L").compression_from_breast([5.0, -1.0, 0.0]).round(6).tolist()
        [5.0, -0.0, 1.0]
        """
        turned: NDArray[np.float64] = np.asarray(vectors, dtype=np.float64) @ self.rotation.T
        return turned

    def breast_from_compression(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Turn vectors or points (..., 3) of the compression frame into the breast frame."""
        turned: NDArray[np.float64] = np.asarray(vectors, dtype=np.float64) @ self.rotation
        return turned

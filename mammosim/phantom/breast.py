"""The uncompressed breast: labelled voxels in the breast frame, with its lesions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import map_coordinates

from mammosim._display import display_of
from mammosim._wording import counted
from mammosim.geometry import VoxelFrame

Posture = Literal["standing", "prone", "supine"]
"""How a woman stands or lies."""


@dataclass(frozen=True, eq=False)
class Lesion:
    """A lesion, clip or calcification cluster whose voxels carry a label of their own.

    Parameters
    ----------
    name : str
    kind : str
        Of `LESION_KINDS`.
    label : int
        Its label in the phantom's voxels.
    tissue : str
        Name of its tissue in the table.
    position_mm : ndarray, (3,)
        Centroid of its voxels, breast frame, mm.
    volume_mm3 : float
        Volume of its material, mm3.
    fill : float
        Fraction of its voxels' volume that is its material; below 1 where calcifications are
        smaller than a voxel, so that they keep their mass.
    """

    name: str
    kind: str
    label: int
    tissue: str
    position_mm: NDArray[np.float64]
    volume_mm3: float
    fill: float = 1.0


@dataclass(frozen=True, eq=False)
class Landmark:
    """A point of the breast that is followed through compression.

    Parameters
    ----------
    name : str
    position_mm : ndarray, (3,)
        Breast frame, mm.
    """

    name: str
    position_mm: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OpenEnd:
    """A plane where the phantom ends and the body goes on, as towards the axilla.

    Parameters
    ----------
    point_mm : ndarray, (3,)
        A point of the plane, breast frame, mm.
    normal : ndarray, (3,)
        Unit vector out of the phantom, breast frame.
    held_depth_mm : ndarray of float32, [x, y, z]
        Depth below the skin as the breast lies in views that do not look along the end, negative
        outside; exact near the skin.
    held_frame : VoxelFrame
        Its grid, breast frame.
    skin_mm : float
        Thickness of the skin there.
    standing : float
        Part of the muscle's stand-off from the wall that is left in those views; the rest of it is
        fat there. 1 if unknown, as for a breast that another program made.
    """

    point_mm: NDArray[np.float64]
    normal: NDArray[np.float64]
    held_depth_mm: NDArray[np.float32]
    held_frame: VoxelFrame
    skin_mm: float
    standing: float = 1.0

    def held_depth_at(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Depth below the skin in views that do not look along the end, (n,) mm, at (n, 3)."""
        index = self.held_frame.index(points_mm).T
        depth: NDArray[np.float64] = map_coordinates(
            self.held_depth_mm, index, output=np.float64, order=1, mode="nearest"
        )
        return depth


@dataclass(frozen=True)
class CompressedState:
    """How a breast is held that was compressed before it was read.

    Its axes are the compression frame's: z from the breast support to the paddle.

    Parameters
    ----------
    view : str or None
        View whose plates hold it; None where that is not known.
    support_z_mm, paddle_z_mm : float or None
        Heights of the plates' faces, mm; None where they are not known.
    edge_mm : float or None
        x of the plates' edge, mm.
    end_side : float
        +1 or -1 where the phantom ends but the body goes on, as to the axilla: the sense along y;
        0 where it does not.
    end_points_mm : tuple of (x, y, z)
        Outermost points of that end, mm.
    """

    view: str | None
    support_z_mm: float | None = None
    paddle_z_mm: float | None = None
    edge_mm: float | None = None
    end_side: float = 0.0
    end_points_mm: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class BreastPhantom:
    """A labelled voxel breast, uncompressed unless it says so.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Labels of the tissue table, and of the lesions.
    voxel_mm : ndarray, (3,)
        Voxel size, mm.
    origin_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0] in the breast frame (+x anterior, +y patient's left,
        +z superior), mm.
    laterality : {"L", "R"}
    tissue_of_label : mapping of int to str
        Tissue of every label that may occur in `labels`, lesions included; 0 is air.
    nipple_mm : ndarray, (3,)
        Tip of the nipple, or most anterior tissue voxel, breast frame, mm.
    lesions : tuple of Lesion
    landmarks : tuple of Landmark
    open_end : OpenEnd or None
        Where the body goes on though its voxels end; None where skin closes it or it is not known.
    muscle_standing : float
        Part of the muscle's stand-off from the chest wall that is left, where the view that it is
        held for has it set back (`OpenEnd.standing`); else 1.
    compressed : CompressedState or None
        Where plates hold it already; its breast frame is the compression frame then.
    shaped_under : {"standing", "prone", "supine"} or None
        Posture in whose weight it has this shape; None where the shape is free of weight.
    source : str
        Where it came from: file name or generator.
    orientation : str
        How a file's axes were taken to lie, in words.
    notes : tuple of str
        What was assumed or mended while reading, one sentence each.
    """

    labels: NDArray[np.uint8]
    voxel_mm: NDArray[np.float64]
    origin_mm: NDArray[np.float64]
    laterality: str
    tissue_of_label: Mapping[int, str]
    nipple_mm: NDArray[np.float64]
    lesions: tuple[Lesion, ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    open_end: OpenEnd | None = None
    muscle_standing: float = 1.0
    compressed: CompressedState | None = None
    shaped_under: Posture | None = None
    source: str = ""
    orientation: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def frame(self) -> VoxelFrame:
        """The voxel grid in the breast frame."""
        nx, ny, nz = self.labels.shape
        return VoxelFrame(self.origin_mm, self.voxel_mm, (nx, ny, nz))

    def __repr__(self) -> str:
        voxels = " x ".join(str(count) for count in self.labels.shape)
        sizes = " x ".join(f"{step:g}" for step in self.voxel_mm)
        return (
            f"<BreastPhantom {self.laterality}: {voxels} voxels of {sizes} mm, "
            f"{counted(len(self.lesions), 'lesion')}, from {self.source or 'unknown source'}>"
        )

    def _repr_html_(self) -> str:
        """Sections through the first lesion and a table of facts, for notebooks."""
        html: str = display_of(self, "html")(self)
        return html

    def plot(self, *, through_mm: ArrayLike | None = None, axes: Any = None) -> Any:
        """Draw three plane sections.

        Parameters
        ----------
        through_mm : array_like, (3,), optional
            The point that they pass through, breast frame, mm; default: the first lesion, or
            without lesions the middle of the breast behind the nipple.
        axes : sequence of three matplotlib axes, optional
            Where to draw; default: a new figure.

        Returns
        -------
        ndarray of matplotlib axes, (3,)
            Frontal, sagittal, transverse. Lesions are circled, also those in front of the plane or
            behind it.
        """
        return display_of(self, "plot")(self, through_mm=through_mm, axes=axes)

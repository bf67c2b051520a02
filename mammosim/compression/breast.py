"""The compressed breast: plates, displacement field, and what compression cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim._display import display_of
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.inverse import InverseMap
from mammosim.compression.model import MODELS
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, Posture


@dataclass(frozen=True, eq=False)
class CompressedBreast:
    """A breast between paddle and support.

    Parameters
    ----------
    phantom : BreastPhantom
        The breast before compression, with its own fine labels.
    view : View
    model : str
        Name of the mechanical model, `none` for a breast left as it is.
    field : DisplacementField
        Displacement on the lattice.
    support_z_mm, paddle_z_mm : float
        Heights of the plates' faces, compression frame, mm.
    plate_edge_mm : float
        Breast-frame x of the plates' edge, mm.
    converged : bool
        Whether the solver reached its tolerance.
    measures : mapping of str to float
        Scalars of the result (force_n, contact areas, volumes, inverted cells, residual, ...),
        units in their names; written to `compression.json`.
    history : ndarray, structured
        One row an iteration; written to `convergence.csv`.
    notes : tuple of str
        Warnings, one sentence each.
    interrupted : bool
        Whether the user stopped the solver.
    modulus_kpa : ndarray of float32, [x, y, z], optional
        Young's modulus at rest of each lattice node (`springs`), or of each element, the cell
        after its node (`hyperelastic`), kPa; 0 in air. None where nothing was computed.
    posture : {"standing", "prone", "supine"}, optional
        How the woman stands or lies, where only weight moved tissue (`in_posture`).
    """

    phantom: BreastPhantom
    view: View
    model: str
    field: DisplacementField
    support_z_mm: float
    paddle_z_mm: float
    plate_edge_mm: float
    converged: bool
    measures: Mapping[str, float]
    history: NDArray[np.void]
    notes: tuple[str, ...] = ()
    interrupted: bool = False
    modulus_kpa: NDArray[np.float32] | None = None
    posture: Posture | None = None

    @property
    def is_compressed(self) -> bool:
        """Whether its model moves tissue, or left the breast as it was."""
        return MODELS[self.model].compresses

    @property
    def thickness_mm(self) -> float:
        """Gap between the plates' faces, mm."""
        return self.paddle_z_mm - self.support_z_mm

    @property
    def force_n(self) -> float:
        """Force on the paddle, N."""
        return self.measures["force_n"]

    @property
    def error_mm(self) -> tuple[float, float]:
        """Estimated distance from equilibrium, mean and largest, mm; NaN where it is not known."""
        missing = float("nan")
        mean, largest = (
            float(self.measures.get(key, missing)) for key in ("error_mm", "largest_error_mm")
        )
        return mean, largest

    def displacement_at(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) displacement in mm at uncompressed points (n, 3), both in the breast frame."""
        return self.field.displacement_at(points_mm)

    def original_point(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) uncompressed place of compressed points (n, 3), both in the breast frame, mm.

        Rows are NaN where no tissue came to lie.
        """
        return self.field.original_point(points_mm)

    @property
    def inverse(self) -> InverseMap:
        """The map from the compressed breast back to the uncompressed one, on a regular grid."""
        return self.field.inverse

    def __repr__(self) -> str:
        state = "" if self.converged else ", not converged"
        force = self.measures.get("force_n")
        pressed = f", {force:.1f} N" if force is not None else ""
        return (
            f"<CompressedBreast {self.view.folder}: {self.model}, {self.thickness_mm:.1f} mm"
            f"{pressed}{state}>"
        )

    def _repr_html_(self) -> str:
        """Sections before and after, and a table of facts, for notebooks."""
        html: str = display_of(self, "html")(self)
        return html

    def plot(
        self, what: Literal["planes", "displacement", "convergence"] = "planes", *, axes: Any = None
    ) -> Any:
        """Draw the compression.

        Parameters
        ----------
        what : {"planes", "displacement", "convergence"}
            Plane sections before and after; arrows from where tissue was to where it is, on the
            three planes; or how the solver converged.
        axes : matplotlib axes, optional
            Where to draw: (2, 3), (3,) or one of them; default: a new figure.

        Returns
        -------
        ndarray of matplotlib axes, or one

        Raises
        ------
        InputError
            If `what` is none of these.
        """
        return display_of(self, "plot")(self, what, axes=axes)

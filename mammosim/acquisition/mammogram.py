"""The mammogram: the recorded signal and the For Presentation image."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim._display import display_of
from mammosim.acquisition._kernels import add_scatter_kernel
from mammosim.acquisition.scatter import DoseMap
from mammosim.geometry import Gantry


@dataclass(frozen=True)
class GlandularDose:
    """Mean glandular dose by one method.

    Parameters
    ----------
    mgd_mgy : float
        Mean glandular dose, mGy.
    mgd_per_kerma : float
        The same over the incident air kerma at the breast's upper surface, mGy/mGy.
    """

    mgd_mgy: float
    mgd_per_kerma: float


@dataclass(frozen=True, eq=False)
class Dose:
    """Dose of one exposure.

    Parameters
    ----------
    method : str
        Where the dose comes from: `monte-carlo` or `dance`.
    by : mapping of str to GlandularDose
        By each method that was used.
    all_gland_mgy : float
        Mean dose of all gland, also of that behind the beam's edge, mGy; NaN without Monte Carlo.
    error : float
        Standard error of Monte Carlo's glandular dose over itself; NaN without it.
    material_mgy : mapping of str to float
        Mean dose of each material in the beam, mGy; `skin` is the skin dose.
    dose_map : DoseMap or None
        Dose of each voxel, mGy, where it was asked for.
    """

    method: str
    by: Mapping[str, GlandularDose]
    all_gland_mgy: float = float("nan")
    error: float = float("nan")
    material_mgy: Mapping[str, float] = field(default_factory=dict)
    dose_map: DoseMap | None = None

    @property
    def mgd_mgy(self) -> float:
        """Mean glandular dose, mGy, of the gland in the beam."""
        return self.by[self.method].mgd_mgy

    @property
    def mgd_per_kerma(self) -> float:
        """Mean glandular dose over incident air kerma, mGy/mGy."""
        return self.by[self.method].mgd_per_kerma


@dataclass(frozen=True, eq=False)
class IodineImage:
    """Iodine on each ray, recombined from a low- and a high-energy exposure.

    Parameters
    ----------
    mg_cm2 : ndarray of float32, [row, column]
        Iodine over that of the breast's middle, mg/cm2.
    flattened_mg_cm2 : ndarray of float32, [row, column]
        The same without its wide background, for presentation.
    weight : float
        Weight of the low-energy image.
    per_mg_cm2 : float
        Change of the weighted difference of the logarithms for 1 mg/cm2.
    """

    mg_cm2: NDArray[np.float32]
    flattened_mg_cm2: NDArray[np.float32]
    weight: float
    per_mg_cm2: float


@dataclass(frozen=True, eq=False)
class ContrastPair:
    """What follows a mammogram with a contrast agent, which is the low-energy exposure.

    Parameters
    ----------
    high_energy : Mammogram
    iodine : IodineImage
    """

    high_energy: Mammogram
    iodine: IodineImage


@dataclass(frozen=True, eq=False)
class Mammogram:
    """A full-field digital mammogram with its technique.

    Parameters
    ----------
    for_processing : ndarray of uint16, [row, column]
        Linear in exposure; air is bright.
    for_presentation : ndarray of uint16, [row, column]
        For reading: gland is bright, air is 0.
    window_center, window_width : float
        Display window of `for_presentation`.
    gantry : Gantry
    thickness_mm, force_n : float
        Compressed thickness, mm, and force on the paddle, N.
    target, filter : str
        Anode and filter material, as `W` and `Rh`.
    filter_mm : float
        Filter thickness, mm.
    kvp, mas : float
        Tube voltage, kV, and tube load, mAs.
    hvl_mm_al : float
        Half-value layer behind the paddle, mm Al.
    air_kerma_mgy : float
        Incident air kerma at the breast's upper surface below the paddle, mGy.
    dose_mgy : float
        Mean glandular dose, mGy.
    grid : bool
        Whether an anti-scatter grid was in.
    measures : mapping of str to float
        Other numbers of the picture (scatter-to-primary ratio, noise, density, ...).
    notes : tuple of str
        Warnings, one sentence each.
    detector : str
        Name of the detector, of `DETECTORS`; empty where it is not known.
    focal_spot_mm : float
        Nominal size of the focal spot, mm.
    automatic_exposure : bool
        Whether exposure control chose the tube load.
    primary : ndarray of float32, [row, column], or None
        Mean primary signal in front of the grid, without blur and noise, keV a pixel.
    scatter_cells : ndarray of float64, [row, column], or None
        Mean scatter signal in front of the grid of the pixels of square cells, keV a pixel.
    cell_px : int
        Pixels along the side of a cell.
    scatter_model : str
        Name of the scatter model that ran.
    dose : Dose or None
    contrast : ContrastPair or None
        The high-energy exposure and the image of iodine, with a contrast agent.
    implant : bool
        Whether there is an implant in the breast.
    """

    for_processing: NDArray[np.uint16]
    for_presentation: NDArray[np.uint16]
    window_center: float
    window_width: float
    gantry: Gantry
    thickness_mm: float
    force_n: float
    target: str
    filter: str
    filter_mm: float
    kvp: float
    mas: float
    hvl_mm_al: float
    air_kerma_mgy: float
    dose_mgy: float
    grid: bool
    measures: Mapping[str, float]
    notes: tuple[str, ...] = ()
    detector: str = ""
    focal_spot_mm: float = math.nan
    automatic_exposure: bool = True
    primary: NDArray[np.float32] | None = None
    scatter_cells: NDArray[np.float64] | None = None
    cell_px: int = 1
    scatter_model: str = ""
    dose: Dose | None = None
    contrast: ContrastPair | None = None
    implant: bool = False

    @property
    def dose_method(self) -> str:
        """Where `dose_mgy` comes from: `monte-carlo` or `dance`."""
        return self.dose.method if self.dose is not None else "dance"

    @cached_property
    def scatter(self) -> NDArray[np.float32] | None:
        """[row, column] mean scatter signal in front of the grid, keV a pixel.

        Over `primary` it is the scatter-to-primary ratio.
        """
        if self.scatter_cells is None:
            return None
        signal = np.zeros(self.for_processing.shape, np.float32)
        add_scatter_kernel(
            self.scatter_cells, float(self.cell_px), 0.0, 1.0, signal, np.zeros_like(signal)
        )
        return signal

    def __repr__(self) -> str:
        rows, columns = self.for_processing.shape
        return (
            f"<Mammogram {self.gantry.view.folder}: {rows} x {columns} pixels of "
            f"{self.gantry.pixel_mm:g} mm, {self.kvp:g} kV {self.target}/{self.filter}, "
            f"{self.mas:.0f} mAs, {self.dose_mgy:.2f} mGy>"
        )

    def _repr_html_(self) -> str:
        """The For Presentation image and a table of facts, for notebooks."""
        html: str = display_of(self, "html")(self)
        return html

    def save(self, folder: str | PathLike[str]) -> None:
        """Write the image as a run does: DICOM objects, TIFF, PNG, and the view's geometry.

        Parameters
        ----------
        folder : path
            Is made if it is missing; files of the same names are replaced. Without the path
            lengths there are no lesion masks.

        Raises
        ------
        InputError
            If a file cannot be written.
        """
        display_of(self, "save")(self, folder)

    def plot(
        self,
        targets: Sequence[Any] = (),
        *,
        window: tuple[float, float] | None = None,
        axes: Any = None,
    ) -> Any:
        """Draw the For Presentation image.

        Parameters
        ----------
        targets : sequence of Target
            Targets to mark, as `study.targets`; those of other views are skipped.
        window : (float, float), optional
            Window center and width; default: the image's own.
        axes : matplotlib axes, optional
            Where to draw; default: a new figure.

        Returns
        -------
        matplotlib axes
            In pixels of the image.
        """
        return display_of(self, "plot")(self, targets, window=window, axes=axes)

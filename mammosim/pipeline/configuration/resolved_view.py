"""One view of a run with its settings as they hold for it: the sections' and the view's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mammosim.acquisition import AcquisitionSettings
from mammosim.compression import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import Posture
from mammosim.projection import ProjectionSettings
from mammosim.reconstruction import SeriesSettings

ViewName = Literal["CC", "MLO", "ML"]


@dataclass(frozen=True)
class BiopsyPosition:
    """How the breast is held while a needle goes for what a view showed.

    Parameters
    ----------
    view : {"CC", "MLO", "ML"}
    compression : CompressionSettings
    posture : {"standing", "prone", "supine"}, optional
        Without plates: how the woman stands or lies.
    """

    view: ViewName
    compression: CompressionSettings
    posture: Posture | None = None

    def position(self, laterality: str) -> View:
        """The view of one breast."""
        return View(self.view, laterality, self.compression.mlo_angle_deg)


@dataclass(frozen=True)
class ResolvedView:
    """One view of a run; its settings are complete and are passed on unchanged.

    Parameters
    ----------
    view : {"CC", "MLO", "ML"}
    compression : CompressionSettings
    projection : ProjectionSettings
    acquisition : AcquisitionSettings
    tomosynthesis : SeriesSettings, optional
        How the tube moves, and what is reconstructed, where the view is taken as a series of
        projections.
    biopsy : BiopsyPosition, optional
        Where `targets.biopsy` is asked for.
    dose_map : bool
        Whether `export.dose_map` asks for the dose of every voxel.
    title : str
        The view's own name in the run; empty where it has none.
    """

    view: ViewName
    compression: CompressionSettings
    projection: ProjectionSettings
    acquisition: AcquisitionSettings
    tomosynthesis: SeriesSettings | None = None
    biopsy: BiopsyPosition | None = None
    dose_map: bool = False
    title: str = ""

    def position(self, laterality: str) -> View:
        """The view of one breast."""
        series = self.tomosynthesis is not None
        held = self.compression
        return View(
            self.view, laterality, held.mlo_angle_deg, series, title=self.title, spot=held.spot
        )

    @property
    def label(self) -> str:
        """What the run calls the view, as `CC` or `CC_DBT`."""
        return self.position("L").label

    def reconstructed(self, shadow_mm2: float, thickness_mm: float) -> tuple[int, int]:
        """Pixels of all projections that slices are made of, and voxels of the slices; 0 without.

        Parameters
        ----------
        shadow_mm2 : float
            Area of the breast's shadow over the arc, mm2.
        thickness_mm : float
            Of the compressed breast, mm.
        """
        series, pixel_mm = self.tomosynthesis, self.projection.pixel_mm
        if series is None or series.reconstruct is None:
            return 0, 0
        voxel_mm3 = (series.reconstruct.pixel_mm or pixel_mm) ** 2 * series.reconstruct.slice_mm
        pixels = round(series.projections * shadow_mm2 / pixel_mm**2)
        return pixels, round(shadow_mm2 * thickness_mm / voxel_mm3)

"""Records of a run: what one view gave, and what all gave together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim._display import display_of
from mammosim._wording import counted
from mammosim.acquisition import Mammogram, Tomosynthesis
from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.pipeline.configuration import RunConfig
from mammosim.projection import PathLengths
from mammosim.reconstruction import Reconstruction
from mammosim.targets import LesionShiftResults, Target

OnProgress = Callable[[str, str, np.void | None], None]
"""Called with a view's folder or '', a stage, and a row of the solver's history or None."""


@dataclass(frozen=True, eq=False)
class ViewResult:
    """One view as far as it came; what was not reached is None or empty.

    Parameters
    ----------
    compressed : CompressedBreast
    paths : PathLengths, optional
        Of a series of projections, those of the middle one; so are `mammogram` and `targets`.
    mammogram : Mammogram, optional
    targets : tuple of Target
        Lesions, then landmarks, then the nipple.
    series : Tomosynthesis, optional
        The projections, where the view was taken as a series.
    lesion_images : tuple of ndarray of uint8 or uint16, [row, column]
        Of a series, the label image of the lesions in each projection; empty without lesions.
    reconstruction : Reconstruction, optional
        Of a series, the slices, where `dbt.reconstruct` asks for them.
    """

    compressed: CompressedBreast
    paths: PathLengths | None = None
    mammogram: Mammogram | None = None
    targets: tuple[Target, ...] = ()
    series: Tomosynthesis | None = None
    lesion_images: tuple[NDArray[np.unsignedinteger], ...] = ()
    reconstruction: Reconstruction | None = None

    def __repr__(self) -> str:
        reached = "mammogram" if self.mammogram is not None else "compression"
        if self.series is not None:
            reached = counted(len(self.series.gantries), "projection")
        targets = counted(len(self.targets), "target")
        return f"<ViewResult {self.compressed.view.folder}: {reached}, {targets}>"


@dataclass(frozen=True, eq=False)
class Study:
    """A run's results.

    Parameters
    ----------
    breasts : tuple of BreastPhantom
        The uncompressed breasts, in the order of the configuration's sides.
    views : mapping of str to ViewResult
        By laterality and view, as `LCC`; a series of projections as `LCC_DBT`.
    stage_seconds : mapping of str to float
        Wall time of each stage, s.
    answers : LesionShiftResults
        Rules between views, biopsy and uncertainty.
    config : RunConfig, optional
        What was asked for.
    """

    breasts: tuple[BreastPhantom, ...]
    views: Mapping[str, ViewResult] = field(default_factory=dict)
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    answers: LesionShiftResults = field(default_factory=LesionShiftResults)
    config: RunConfig | None = None

    @property
    def breast(self) -> BreastPhantom:
        """The uncompressed breast; of two the first."""
        return self.breasts[0]

    @property
    def targets(self) -> tuple[Target, ...]:
        """One row of `lesions.csv` per target and view; each target has its own number."""
        return tuple(target for view in self.views.values() for target in view.targets)

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings of all stages, one sentence each."""
        notes = [note for breast in self.breasts for note in breast.notes]
        notes += self.answers.notes
        for view in self.views.values():
            notes += [*view.compressed.notes, *(view.mammogram.notes if view.mammogram else ())]
            if not view.compressed.converged:
                notes.append(f"{view.compressed.view.folder}: the compression did not converge")
        return tuple(notes)

    def __repr__(self) -> str:
        sides = ", ".join(breast.laterality for breast in self.breasts)
        lesions = counted(sum(len(breast.lesions) for breast in self.breasts), "lesion")
        return f"<Study of {sides}: {', '.join(self.views) or 'no views'}, {lesions}>"

    def _repr_html_(self) -> str:
        """The mammograms with lesions marked, and how far each moved, for notebooks."""
        html: str = display_of(self, "html")(tuple(self.views.values()), self.targets)
        return html

    def save(self, folder: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the folder that `mammosim run` writes, with pictures, volumes, tables and report.

        Parameters
        ----------
        folder : path
            The run's folder.
        overwrite : bool
            Whether files in a folder that is not empty are replaced.

        Raises
        ------
        InputError
            If the folder is not empty or cannot be written, or the study was not simulated from a
            configuration.

        Notes
        -----
        Of `acquisition.realisations`, only the first is kept in memory and written; let `simulate`
        write the others by its `output`.
        """
        display_of(self, "save")(self, folder, overwrite=overwrite)

    def plot(self, *, axes: Any = None) -> Any:
        """Draw the mammograms with their lesions.

        Parameters
        ----------
        axes : sequence of matplotlib axes, optional
            Where to draw, one per mammogram; default: a new figure.

        Returns
        -------
        ndarray of matplotlib axes
        """
        return display_of(self, "plot")(tuple(self.views.values()), self.targets, axes=axes)

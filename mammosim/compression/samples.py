"""The compression of one breast over and over: other moduli, other plates, another lattice."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mammosim._jit import one_blas_thread
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.model import MODELS
from mammosim.compression.posture import in_posture
from mammosim.compression.settings import CompressionSettings, SkinSettings
from mammosim.compression.thesis_units import in_millimetres
from mammosim.compression.unloading import compress_unloaded
from mammosim.errors import Interrupted, NotConverged
from mammosim.phantom import BreastPhantom
from mammosim.tissues import TISSUES

LATTICE_SHIFTS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Parts of the spacing along y and z by which the lattices lie off their usual place."""

FASCIA = "fascia"
"""Name of its stiffness among the groups of tissues."""

FIBRES = "fibres"
"""Name of the key of the settings that says how much stiffer tissue is along fibres."""

MAX_FIBRE_RATIO = 20.0
"""As `FibreSettings` allows."""

FASCIA_SPREAD = 3.0
"""Standard deviation of the logarithm of the fascia's stiffness, in those of a tissue's modulus:
nobody has measured it in women (assumed)."""

STIFFENING = "skin_stiffening"
"""Name of how skin stiffens with stretch among the groups of tissues."""

STIFFENING_SPREAD = 2.0
"""Standard deviation of the logarithm of how skin stiffens, in those of a tissue's modulus: at the
default it is 0.7, and twice that takes 6 to 24, with which the modulus of strong suction belongs
to a stretch of 1.3, about the least of the largest stretches in women (1.25 to 1.6, Khatam et al.
2015); that it spreads as far to the other side is assumed."""

MAX_STIFFENING = 100.0
"""As `SkinSettings` allows."""

THINNEST = 0.5
"""Of the thickness that is varied: no sample is compressed further."""


@dataclass(frozen=True)
class Sample:
    """One sample: how it deviates from the compression that is varied.

    Parameters
    ----------
    stiffness : mapping of str to float
        Factor of the moduli of each group of tissues; 1 where a group is not named. That of
        `fascia` and `skin_stiffening` is taken to the power of their spread.
    thickness_mm, height_mm, edge_mm : float
        Added to the gap, to both plates' height, and to the place of their edge.
    lattice : int
        Number of the lattice, modulo how many there are.
    fibre_ratio : float, optional
        Modulus along fibres over that across them; None: as in the compression that is varied.
    """

    stiffness: Mapping[str, float]
    thickness_mm: float = 0.0
    height_mm: float = 0.0
    edge_mm: float = 0.0
    lattice: int = 0
    fibre_ratio: float | None = None

    def __str__(self) -> str:
        """The deviations in a few words."""
        moduli = [f"{group} x {factor:.2f}" for group, factor in self.stiffness.items()]
        plates = (
            f"gap {self.thickness_mm:+.1f}, height {self.height_mm:+.1f}, "
            f"edge {self.edge_mm:+.1f} mm"
        )
        fibres = [] if self.fibre_ratio is None else [f"fibres {self.fibre_ratio:.2f}"]
        lattice = f"lattice {self.lattice % len(LATTICE_SHIFTS)}"
        return ", ".join([plates, *moduli, *fibres, lattice])


def stiffness_group(tissue: str) -> str:
    """The tissue at the end of the chain of those that a tissue is like in stiffness.

    Examples
    --------
    >>> stiffness_group("duct"), stiffness_group("skin")
    ('gland', 'skin')
    """
    entry = TISSUES[tissue]
    while entry.like is not None:
        entry = TISSUES[entry.like]
    return entry.name


class Sampler:
    """Compressions of one breast that deviate from a given one, by the same model.

    Parameters
    ----------
    compressed : CompressedBreast
        The compression that is varied, its plates where they were found to be; or a breast without
        plates in a posture.
    settings : CompressionSettings
        That it was made with, but for what the model has for samples (`sample_keys`): springs are
        solved by `multigrid`.

    Attributes
    ----------
    groups : tuple of str
        What can be varied in stiffness: groups of tissues that occur in the breast, then `fascia`
        where it holds the breast, and `skin_stiffening` where skin is a sheet that stiffens.
    has_fibres : bool
        Whether the model knows fibres.

    Notes
    -----
    Each sample is compressed from rest, and so depends on no other, nor on the number of threads.
    Starting from the compression that is varied saves nothing: coarse lattices lead to the new
    place of the plates in as few steps on the finest one (docs/explanation/biopsy-shift.md).
    """

    def __init__(self, compressed: CompressedBreast, settings: CompressionSettings) -> None:
        self._breast, self._view = compressed.phantom, compressed.view
        self._posture = compressed.posture
        self._model = settings.model if self._posture else compressed.model
        self._middle_mm = 0.5 * (compressed.support_z_mm + compressed.paddle_z_mm)
        self._thickness_mm, self._edge_mm = compressed.thickness_mm, compressed.plate_edge_mm
        self._settings = in_millimetres(settings, compressed.phantom, compressed.view)
        own_keys = MODELS[self._model].own_keys
        self.groups = _groups(compressed.phantom)
        if settings.wall == FASCIA:
            self.groups += (FASCIA,)
        sheet = settings.skin_sheet if "skin" in own_keys and "skin" in self.groups else None
        if sheet is not None and sheet.stiffening > 0.0:
            self.groups += (STIFFENING,)
        self.has_fibres = FIBRES in own_keys

    @one_blas_thread
    def compressed(
        self, sample: Sample, watch: Callable[[np.void], None] | None = None
    ) -> CompressedBreast:
        """The breast as one sample has it; its `converged` says how the solver ended.

        Parameters
        ----------
        sample : Sample
        watch : callable, optional
            Called with each row of the history, for progress.

        Raises
        ------
        Interrupted
            If the user stopped it.
        """
        shift = LATTICE_SHIFTS[sample.lattice % len(LATTICE_SHIFTS)]
        settings = self._varied(sample)
        try:
            if self._posture is not None:
                found = in_posture(self._breast, self._view, settings, self._posture, watch, shift)
            else:
                found = compress_unloaded(
                    self._breast, self._view, settings, watch=watch, lattice_shift=shift
                )
        except NotConverged as stop:  # the posture's, or that of the shape without weight
            found = stop.reached
        if found.interrupted:
            raise Interrupted(f"{self._view.folder}: a sample was interrupted", found)
        return found

    def field(
        self, sample: Sample, watch: Callable[[np.void], None] | None = None
    ) -> DisplacementField | None:
        """Displacement of one sample; None where the solver did not reach its tolerance."""
        found = self.compressed(sample, watch)
        return found.field if found.converged else None

    def _varied(self, sample: Sample) -> CompressionSettings:
        middle = self._middle_mm + sample.height_mm
        gap = max(self._thickness_mm + sample.thickness_mm, THINNEST * self._thickness_mm)
        moduli = {
            tissue: sample.stiffness.get(stiffness_group(tissue), 1.0)
            * self._settings.moduli(tissue)
            for tissue, entry in TISSUES.items()
            if tissue != "air" and not entry.mixture  # mixtures follow their parts
        }
        changes: dict[str, Any] = {
            "thickness_mm": None,
            "force_n": None,
            "support_z_mm": middle - 0.5 * gap,
            "paddle_z_mm": middle + 0.5 * gap,
            "plate_edge_mm": self._edge_mm + sample.edge_mm,
            "stiffness_kpa": moduli,
            **self._varied_structure(sample, moduli),
            **MODELS[self._model].sample_keys,
        }
        return self._settings.model_copy(update=changes)

    def _varied_structure(self, sample: Sample, moduli: dict[str, float]) -> dict[str, Any]:
        """Fibres, fascia, and skin where it is a sheet, whose modulus it then is."""
        settings, sheet = self._settings, self._settings.skin_sheet
        changes: dict[str, Any] = {}
        if sample.fibre_ratio is not None:
            ratio = min(sample.fibre_ratio, MAX_FIBRE_RATIO)
            changes[FIBRES] = settings.fibres.model_copy(update={"ratio": ratio})
        if FASCIA in sample.stiffness:
            factor = sample.stiffness[FASCIA] ** FASCIA_SPREAD
            changes["fascia_kpa_per_mm"] = factor * settings.fascia_kpa_per_mm
        if sheet is not None:
            moduli["skin"] = sample.stiffness.get("skin", 1.0) * sheet.young_kpa
            skin: dict[str, float | None] = {"young_kpa": None}
            if STIFFENING in sample.stiffness:
                factor = sample.stiffness[STIFFENING] ** STIFFENING_SPREAD
                skin["stiffening"] = min(factor * sheet.stiffening, MAX_STIFFENING)
            if settings.skin is not None or STIFFENING in sample.stiffness:
                changes["skin"] = (settings.skin or SkinSettings()).model_copy(update=skin)
        return changes


def _groups(breast: BreastPhantom) -> tuple[str, ...]:
    present = np.zeros(256, bool)
    for plane in breast.labels:
        present |= np.bincount(plane.ravel(), minlength=256) > 0
    names = {
        stiffness_group(part)
        for label, name in breast.tissue_of_label.items()
        if name != "air" and present[label]
        for part in TISSUES[name].mixture or (name,)
    }
    return tuple(sorted(names))

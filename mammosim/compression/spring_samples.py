"""The spring model of one breast over and over: other moduli, other plates, another lattice.

What does not change from sample to sample is made once: the lattices, the part that each group of
tissues has in every node's modulus, and what is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.lattice import tissue_mean
from mammosim.compression.plates import Plates, held_tissue
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_case import SpringCase, make_case
from mammosim.compression.spring_model import displacement_field
from mammosim.compression.springs import solve
from mammosim.compression.thesis_units import in_millimetres
from mammosim.phantom import BreastPhantom
from mammosim.tissues import TISSUES, Moduli

SAMPLE_TOLERANCE = 0.01
"""Of a sample's equilibrium, lattice units: a hundredth of what samples of a 1 mm lattice differ
by."""

LATTICE_SHIFTS = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
"""Parts of the spacing along y and z by which the lattices lie off their usual place."""

THINNEST = 0.5
"""Of the thickness that is varied: no sample is compressed further."""


@dataclass(frozen=True)
class SpringSample:
    """One sample: how it deviates from the compression that is varied.

    Parameters
    ----------
    stiffness : mapping of str to float
        Factor of the moduli of each group of tissues; 1 where a group is not named.
    thickness_mm, height_mm, edge_mm : float
        Added to the gap, to both plates' height, and to the place of their edge.
    lattice : int
        Number of the lattice, modulo how many there are.
    """

    stiffness: Mapping[str, float]
    thickness_mm: float = 0.0
    height_mm: float = 0.0
    edge_mm: float = 0.0
    lattice: int = 0


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


class SpringSampler:
    """Compressions of one breast that deviate from a given one.

    Parameters
    ----------
    squeezed : CompressedBreast
        The compression that is varied; its plates are where they were found to be.
    settings : CompressionSettings
        That it was made with.
    vary_lattice : bool
        Whether samples may use shifted lattices.

    Attributes
    ----------
    groups : tuple of str
        Groups of tissues whose stiffness can be varied: those that occur in the breast.
    """

    def __init__(
        self, squeezed: CompressedBreast, settings: CompressionSettings, vary_lattice: bool = True
    ) -> None:
        breast = squeezed.phantom
        self._view = squeezed.view
        self._plates = Plates(squeezed.support_z_mm, squeezed.paddle_z_mm, squeezed.plate_edge_mm)
        self.groups = _groups(breast)
        settings = in_millimetres(settings, breast, squeezed.view)
        reach, muscle_fixed = held_tissue(settings, breast)
        self._cases: list[tuple[SpringCase, dict[str, NDArray[np.float32]]]] = []
        for shift in LATTICE_SHIFTS if vary_lattice else LATTICE_SHIFTS[:1]:
            case = make_case(breast, squeezed.view, settings, reach, muscle_fixed, shift)
            self._cases.append((case, self._parts(breast, case, settings.moduli)))

    def field(self, sample: SpringSample) -> DisplacementField | None:
        """Displacement of one sample; None where the solver did not reach its tolerance."""
        case, parts = self._cases[sample.lattice % len(self._cases)]
        modulus = np.zeros_like(case.lattice.modulus)
        for group, part in parts.items():
            modulus += np.float32(sample.stiffness.get(group, 1.0)) * part
        state = solve(replace(case.problem(self._placed(sample)), modulus=modulus),
                      SAMPLE_TOLERANCE)  # fmt: skip
        return displacement_field(self._view, case, state) if state.converged else None

    def _placed(self, sample: SpringSample) -> Plates:
        plates = self._plates
        middle = 0.5 * (plates.support_z_mm + plates.paddle_z_mm) + sample.height_mm
        gap = max(plates.thickness_mm + sample.thickness_mm, THINNEST * plates.thickness_mm)
        return Plates(middle - 0.5 * gap, middle + 0.5 * gap, plates.edge_mm + sample.edge_mm)

    def _parts(
        self, breast: BreastPhantom, case: SpringCase, moduli: Moduli
    ) -> dict[str, NDArray[np.float32]]:
        """What each group adds to the nodes' moduli, kPa; together they are the moduli."""
        parts = {}
        for group in self.groups:

            def one_more(tissue: str, group: str = group) -> float:
                own = stiffness_group(tissue) == group
                return 1.0 + (moduli(tissue) if own else 0.0)

            # Means are taken of positive properties: one is added, and taken away again.
            mean = tissue_mean(breast, self._view, case.lattice, one_more)
            parts[group] = np.where(case.lattice.tissue, mean - np.float32(1.0), np.float32(0.0))
        return parts


def _groups(breast: BreastPhantom) -> tuple[str, ...]:
    present = np.zeros(256, bool)
    for plane in breast.labels:
        present |= np.bincount(plane.ravel(), minlength=256) > 0
    names = {
        stiffness_group(name)
        for label, name in breast.tissue_of_label.items()
        if name != "air" and present[label]
    }
    return tuple(sorted(names))

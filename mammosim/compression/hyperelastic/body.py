"""A body of trilinear hexahedra on a regular lattice: what it is made of and what holds it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.compression.hyperelastic._element_kernels import ElementRule, energy_and_forces
from mammosim.compression.hyperelastic._tangent_kernels import tangent_stencil
from mammosim.compression.hyperelastic.fascia import Fascia
from mammosim.compression.hyperelastic.fibres import Fibres
from mammosim.compression.hyperelastic.gravity import Weight
from mammosim.compression.hyperelastic.laws import LAWS
from mammosim.compression.hyperelastic.membrane import Membrane
from mammosim.compression.hyperelastic.structure import Structure
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.hyperelastic.surface_cells import SurfaceCells
from mammosim.compression.multigrid import coarse_shape, row_spans

CORNER_WEIGHT = 1.0 / 24.0
"""Weight of each corner in the deviatoric energy; 1/24 integrates every quadratic exactly."""

SMALLEST_PART = 0.5
"""A cell is an element where at least this part of it is tissue; the moduli of others go to the
elements beside them (cell aggregation: Badia et al. 2018, Comput Methods Appl Mech Eng 336,
533-553), so that no element is mostly void."""

LOCAL_PART = 5.0
"""Part of the bulk modulus, in shear moduli, that acts at each point of an element, and not on the
mean over it: too little to lock (alone it is a Poisson's ratio of 0.41), and enough that corners of
strongly sheared elements do not fold. Where the volume is kept the split makes no difference."""

MIN_VOLUME = 0.1
"""J below which the energy is continued by a parabola, so that an element inverted on the way can
unfold; a solution has no element there."""


Part = Membrane | SurfaceCells | Fascia | Weight | Fibres
"""What has energy beside the elements."""


@dataclass(frozen=True, eq=False)
class Body:
    """Elements, moduli and held displacements, in lattice units.

    Parameters
    ----------
    fraction : ndarray of float32, [x, y, z]
        Part of each cell that is tissue. Cell [i, j, k] lies between nodes [i, j, k] and
        [i + 1, j + 1, k + 1]; one layer around is empty, and two at the high end.
    shear, bulk : ndarray of float32, [x, y, z]
        Moduli mu and kappa of each element, kPa, weighted by its tissue; 0 where there is none.
    held : ndarray of bool, [3, x, y, z]
        Displacements that are held at zero.
    corner_weight, local_part, least_volume : float
        See the constants of these names.
    law : str
        Of the tissues, a name in `LAWS`.
    structure : Structure
        What holds the elements together beside themselves.
    """

    fraction: NDArray[np.float32]
    shear: NDArray[np.float32]
    bulk: NDArray[np.float32]
    held: NDArray[np.bool_]
    corner_weight: float = CORNER_WEIGHT
    local_part: float = LOCAL_PART
    least_volume: float = MIN_VOLUME
    law: str = "neo_hookean"
    structure: Structure = field(default_factory=Structure)

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """Elements that there are, [x, y, z]."""
        return self.shear > 0.0

    @cached_property
    def nodes(self) -> NDArray[np.bool_]:
        """Nodes of at least one element, [x, y, z]."""
        return nodes_of(self.active)

    @cached_property
    def free(self) -> NDArray[np.float32]:
        """1 where a node may move along an axis, else 0, [3, x, y, z]."""
        return (self.nodes & ~self.held).astype(np.float32)

    @cached_property
    def held_rows(self) -> NDArray[np.bool_]:
        """Whether a row of nodes along z has displacements that are held, [x, y]."""
        return np.asarray((self.nodes & self.held).any(axis=(0, 3)))

    @cached_property
    def element_span(self) -> NDArray[np.int32]:
        """First and one past the last element of each row along z, [x, y, 2]."""
        return row_spans(self.active)

    @cached_property
    def node_span(self) -> NDArray[np.int32]:
        """First and one past the last node of each row along z, [x, y, 2]."""
        return row_spans(self.nodes)

    @classmethod
    def of(
        cls,
        fraction: NDArray[np.float32],
        shear: NDArray[np.float32],
        bulk: NDArray[np.float32],
        held: NDArray[np.bool_],
    ) -> Body:
        """Body of cells with given tissue fraction and moduli weighted by it.

        Cells that no chain of elements, face to face, ties to a held node are left out.
        """
        active = _tied(fraction >= SMALLEST_PART, np.asarray(held.any(axis=0)))
        fraction = np.where(active | (fraction < SMALLEST_PART), fraction, np.float32(0.0))
        return cls(fraction, _gathered(shear, active), _gathered(bulk, active), held)

    def coarsened(self) -> Body:
        """The body of cells twice as large: each has the mean of the eight that it replaces."""
        fraction, shear, bulk = (_mean_of_eight(a) for a in (self.fraction, self.shear, self.bulk))
        held = np.zeros((3, *fraction.shape), bool)
        some = self.held[:, 1::2, 1::2, 1::2]
        held[:, 1 : 1 + some.shape[1], 1 : 1 + some.shape[2], 1 : 1 + some.shape[3]] = some
        structure = self.structure.coarsened(_mean_of_eight)
        return replace(Body.of(fraction, shear, bulk, held), law=self.law, structure=structure)

    @cached_property
    def _parts(self) -> list[Part]:
        """What has energy beside the elements."""
        skin, tension = self.structure.skin, 0.0
        parts = list[Part]()
        if skin is not None:
            points, tension = SurfacePoints.of(self.fraction, self.free), skin.tension
            parts.append(Membrane.of(points, skin.covers(points), tension, skin.stiffening))
        parts.append(SurfaceCells.of(self.active, self.shear, tension))
        if self.structure.fascia > 0.0:
            border = self.structure.border(self.active)
            fascia = self.structure.fascia
            parts.append(Fascia.of(self.fraction, self.active, fascia, border))
        if self.structure.mass is not None:
            mass = _gathered(self.structure.mass, self.active)
            parts.append(Weight.of(mass, self.structure.pull))
        if self.structure.fibre_ratio > 1.0:
            origin = np.array(self.structure.fibre_origin)
            parts.append(Fibres.of(self.shear, origin, self.structure.fibre_ratio))
        return parts

    @property
    def _formulas(self) -> tuple[ElementRule, Any]:
        """Rule and law as kernels take them."""
        rule = ElementRule(self.corner_weight, self.local_part, self.least_volume)
        return rule, LAWS[self.law](self.least_volume)

    def energy_and_forces(self, u: NDArray[np.float64]) -> tuple[float, float, NDArray[np.float64]]:
        """Elastic energy, smallest J of any point, and the energy's derivative by each node."""
        force, layers = np.zeros_like(u), np.zeros((u.shape[1] - 1, 2))
        energy_and_forces(
            u, self.shear, self.bulk, self.element_span, *self._formulas, force, layers
        )
        energy = float(layers[:, 0].sum())
        for part in self._parts:
            energy += part.add_forces(u, force)
        return energy, float(layers[:, 1].min()), force

    def add_tangent(
        self, u: NDArray[np.float64], geometric: float, stencil: NDArray[np.float32]
    ) -> None:
        """Add the second derivative of the energy to a block stencil."""
        tangent_stencil(
            u, self.shear, self.bulk, self.element_span, *self._formulas, geometric, stencil
        )
        for part in self._parts:
            part.add_tangent(u, stencil)


def nodes_of(elements: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Nodes that touch at least one of the elements, [x, y, z]."""
    nodes = elements.copy()
    for axis in range(3):
        nodes |= np.roll(nodes, 1, axis)
    return nodes


def _tied(some: NDArray[np.bool_], anchor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Elements that a chain of elements, face to face, ties to an element with a held node."""
    seed = anchor.copy()
    for axis in range(3):
        seed |= np.roll(seed, -1, axis)
    return np.asarray(ndimage.binary_propagation(seed & some, mask=some))


def _gathered(modulus: NDArray[np.float32], active: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Moduli of the elements, each with its share of the cells beside it that are none."""
    beside = sum(
        np.roll(active, shift, axis).astype(np.float32) for axis in range(3) for shift in (-1, 1)
    )
    share = np.divide(modulus, beside, out=np.zeros_like(modulus), where=(beside > 0) & ~active)
    gathered = np.where(active, modulus, np.float32(0.0))
    for axis in range(3):
        for shift in (-1, 1):
            gathered += np.roll(share, shift, axis) * active
    return gathered


def _mean_of_eight(fine: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2 x 2 x 2 elements, the first of which is [1, 1, 1]."""
    shape = coarse_shape(fine.shape)
    whole = np.zeros([2 * (n - 2) for n in shape], np.float32)
    inner = fine[1:, 1:, 1:]
    whole[: inner.shape[0], : inner.shape[1], : inner.shape[2]] = inner
    pairs = whole.reshape(shape[0] - 2, 2, shape[1] - 2, 2, shape[2] - 2, 2)
    coarse = np.zeros(shape, np.float32)
    coarse[1:-1, 1:-1, 1:-1] = pairs.mean(axis=(1, 3, 5))
    return coarse

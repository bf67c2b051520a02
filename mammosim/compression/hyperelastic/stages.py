"""From rest to the plates' final place: coarse bodies first, each the start of a finer one."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from mammosim.compression.continuation import continued
from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import PENALTY, Contact
from mammosim.compression.hyperelastic.friction import STICK_MM, Friction, Grip
from mammosim.compression.hyperelastic.mesh import ALIGNED, Mesh
from mammosim.compression.hyperelastic.newton import State, Step, evaluate, step_of
from mammosim.compression.hyperelastic.sliding import anchors, held_by_friction
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.hyperelastic.trust_region import minimise
from mammosim.compression.hyperelastic.unfolding import smoothed_folds
from mammosim.compression.multigrid import Workspace, add_interpolated
from mammosim.compression.plates import EDGE_RADIUS_MM, Plates

MIN_NODES = 300
"""A body with fewer is no start for a finer one."""

LOOSE = 0.02
"""Mean error, element edges, at which the state of a coarse body is good enough to refine."""

CLOSING_TOLERANCE = 0.05
"""Mean error, element edges, that is good enough while the plates still close."""

UNFOLDING = (30.0, 0.5)
"""`local_part` and `least_volume` of a body whose start may have folded elements, at first: most of
its bulk modulus acts at each point, which unfolds them, and a fold costs little else."""

FOLDED, UNFOLDED = 0.05, 0.2
"""Smallest J of a start below which its elements are unfolded first, and at which that ends."""

STEEP = 0.02
"""`least_volume` of the mesh when its equilibrium is sought: the law's barrier against folding,
which a parabola replaces below it, acts further down than in the bodies that are only starts."""

EDGE_REACH = 4.0
"""Distance from the plates' edge, in units of its radius, within which the surface has several
points an element: it is stretched around the edge there, and would cut through it between points
that are too far apart."""

ROUNDED = 2.0
"""Smallest radius of the plates' edge, in element edges. Round a sharper one the surface passes
element by element, each held back by the edge: there are then many equilibria, and the way of the
plates decides on one."""

INCREMENT = 0.06
"""Part of the breast's height by which the plates close at a time, at first."""

SMALLEST_INCREMENT = INCREMENT / 32.0
"""Five halvings of the first; a step that fails even then is taken as not converging."""

HISTORY = np.dtype(
    [
        ("iteration", np.int64),
        ("element_mm", np.float64),
        ("gap_mm", np.float64),
        ("out_of_balance", np.float64),
        ("depth_mm", np.float64),
        ("force_n", np.float64),
        ("energy_mj", np.float64),
        ("smallest_j", np.float64),
        ("cycles", np.int64),
        ("step", np.float64),
        ("error_mm", np.float64),
    ]
)
"""Columns of the history, one row a Newton step."""


class Held(NamedTuple):
    """Where a body was, and how its plates held it by friction, before they moved.

    Parameters
    ----------
    u : ndarray, [3, x, y, z]
        Displacement, lattice units.
    grip : Grip, optional
        None: there is no friction.
    """

    u: NDArray[np.float64]
    grip: Grip | None


class Stages:
    """The nested bodies of one mesh, and the history of what is solved on them.

    Parameters
    ----------
    mesh : Mesh
    edge_mm : float
        Place along x of the plates' edge, mm.
    tolerance_mm : float
        Estimated mean distance from equilibrium at the end, mm.
    watch : callable, optional
        Called with each row of the history.
    depth_mm : float
        How far the paddle reaches along x in front of that edge, mm, where it ends over the breast.
    friction : float
        Coefficient of friction between the surface and the plates.
    """

    def __init__(
        self,
        mesh: Mesh,
        edge_mm: float,
        tolerance_mm: float,
        watch: Callable[[np.void], None] | None = None,
        depth_mm: float = 0.0,
        friction: float = 0.0,
    ) -> None:
        self.mesh = mesh
        self.friction = friction
        self.tolerance = tolerance_mm / float(mesh.nodes.spacing_mm[0])
        self.bodies = [mesh.body]
        while 2 ** len(self.bodies) <= ALIGNED:
            coarse = self.bodies[-1].coarsened()
            if np.count_nonzero(coarse.nodes) < MIN_NODES:
                break
            self.bodies.append(coarse)
        reach = EDGE_REACH * EDGE_RADIUS_MM
        near = np.array([edge_mm - reach, edge_mm + depth_mm + reach])
        self.points = [
            SurfacePoints.of(body.fraction, body.free, tuple(self._lattice_x(near, level)))
            for level, body in enumerate(self.bodies)
        ]
        self.rows: list[np.void] = []
        self._watch = watch
        self._workspace = Workspace()
        self._softness = _mean_modulus(mesh.body)

    def _frame(self, level: int) -> tuple[NDArray[np.float64], float]:
        """Place of the first node of one of the bodies and the edge of its elements, mm."""
        size = 2.0**level
        corner = self.mesh.nodes.origin_mm + (1.0 - size) * self.mesh.nodes.spacing_mm
        return corner, size * float(self.mesh.nodes.spacing_mm[0])

    def _lattice_x(self, x_mm: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        corner, edge = self._frame(level)
        return (x_mm - corner[0]) / edge

    def contact(self, level: int, plates: Plates) -> Contact:
        """The surface of one of the bodies between plates whose edge its elements can follow."""
        corner, edge = self._frame(level)
        plates = replace(plates, radius_mm=max(plates.radius_mm, ROUNDED * edge))
        return Contact(self.points[level], plates.solids(corner, edge), PENALTY * self._softness)

    def compress(self, plates: Plates, finest: int = 0, start: State | None = None) -> State:
        """State between plates.

        Parameters
        ----------
        plates : Plates
        finest : int
            Number of the body at which to stop, 0 for the mesh itself.
        start : State, optional
            Of the body after `finest`, between plates at or near these; otherwise the breast is
            compressed from rest.
        """
        last = len(self.bodies) - 1
        first = finest if start else last - 1
        state = start or self._close(last, plates)
        for level in range(first, finest - 1, -1):
            u = interpolated(state.u, self.bodies[level + 1], self.bodies[level])
            moved = replace(state, u=u, grip=self._refined(state.grip, level))
            state = moved if state.interrupted else self.settle(plates, moved, level)
        return state

    def settle(self, plates: Plates, start: State, level: int = 0) -> State:
        """State of one of the bodies between plates, from one near it.

        Elements that are folded at the start are smoothed away or, where that does not lead to an
        equilibrium, unfolded by a softened body.
        """
        self._workspace.eigenvalues.clear()  # so that a state follows from its start alone
        body, held = self.bodies[level], Held(start.u, start.grip)
        if body.energy_and_forces(start.u)[1] >= FOLDED:
            return self._finish(level, plates, start.u, held)
        u = smoothed_folds(body, start.u, UNFOLDED)
        if body.energy_and_forces(u)[1] >= FOLDED:
            state = self._finish(level, plates, u, held)
            if state.converged or state.interrupted:
                return state
        local, least = UNFOLDING
        softened = replace(body, local_part=local, least_volume=least)
        contact, gap_mm, u = self.contact(level, plates), plates.thickness_mm, start.u
        state = self._minimise(softened, level, contact, gap_mm, u, CLOSING_TOLERANCE, UNFOLDED)
        return state if state.interrupted else self._finish(level, plates, state.u, held)

    def _finish(self, level: int, plates: Plates, u: NDArray[np.float64], before: Held) -> State:
        """State of one of the bodies from a displacement near it.

        Where folded elements do not unfold against the barrier of the mesh, they first do without.
        """
        body = self.bodies[level]
        if level > 0:
            return self._equilibrium(body, level, plates, u, LOOSE, before)
        steep = replace(body, least_volume=STEEP)
        state = self._equilibrium(steep, level, plates, u, self.tolerance, before)
        if state.converged or state.interrupted:
            return state
        state = self._equilibrium(body, level, plates, u, self.tolerance, before)
        if not state.converged or state.value.smallest >= body.least_volume:
            return state
        return self._equilibrium(steep, level, plates, state.u, self.tolerance, before)

    def at_rest(self, plates: Plates) -> State:
        """The mesh before anything moves, between plates."""
        contact, u = self.contact(0, plates), np.zeros((3, *self.mesh.body.nodes.shape))
        value = evaluate(self.mesh.body, contact, u)
        step = step_of(self.mesh.body, contact, value, 0, 1.0, (np.inf, np.inf))
        return State(u, value, step, False)

    def without_weight(self) -> Stages:
        """The same bodies, on which gravity does not act."""
        if self.mesh.body.structure.mass is None:
            return self
        weightless = copy(self)
        weightless.bodies = [
            replace(body, structure=replace(body.structure, mass=None)) for body in self.bodies
        ]
        return weightless

    def _close(self, level: int, plates: Plates) -> State:
        """State of a body between plates that close from where they touch it, step by step."""
        self._workspace.eigenvalues.clear()  # so that a state follows from its start alone
        u = np.zeros((3, *self.bodies[level].nodes.shape))
        before, done, gone = u, 0.0, 0.0
        open_plates = self._touching(level, plates)
        held = Held(
            u, Grip.none(open_plates, len(self.points[level].area)) if self.friction else None
        )
        closing = open_plates.thickness_mm - plates.thickness_mm
        increment = INCREMENT * open_plates.thickness_mm / max(closing, 1e-9)
        while True:
            part = min(1.0, done + increment)
            between = open_plates.closing_to(plates, part)
            ahead = (part - done) / (done - gone) if done > gone else 0.0
            guess = u + ahead * (u - before)
            if part == 1.0:
                state = self._finish(level, between, guess, held)
            else:
                body = self.bodies[level]
                state = self._equilibrium(body, level, between, guess, CLOSING_TOLERANCE, held)
            if state.interrupted:
                return state
            if state.converged:
                before, u, gone, done = u, state.u, done, part
                held = Held(u, state.grip)
                if done == 1.0:
                    return state
            elif increment * closing < SMALLEST_INCREMENT * open_plates.thickness_mm:
                return state
            else:
                increment *= 0.5

    def _touching(self, level: int, plates: Plates) -> Plates:
        """Plates that just touch the surface in front of their edge, or are where they end."""
        corner, edge = self._frame(level)
        places = self.points[level].cells + self.points[level].local
        ahead = corner + edge * places[places[:, 0] > (plates.edge_mm - corner[0]) / edge]
        beneath = ahead
        if plates.panel is not None:
            beneath = ahead[plates.panel.covers(ahead, plates.edge_mm)]
        low = float(ahead[:, 2].min())
        high = float(beneath[:, 2].max()) if len(beneath) else plates.paddle_z_mm
        return replace(
            plates,
            support_z_mm=min(low, plates.support_z_mm),
            paddle_z_mm=max(high, plates.paddle_z_mm),
        )

    def _refined(self, grip: Grip | None, level: int) -> Grip | None:
        """How plates hold the surface of a body, from how they hold that of its coarsened one."""
        if grip is None:
            return None
        rest = []
        for number in (level, level + 1):
            corner, edge = self._frame(number)
            rest.append(corner + edge * (self.points[number].cells + self.points[number].local))
        return grip.of_points(KDTree(rest[1]).query(rest[0])[1])

    def _equilibrium(
        self,
        body: Body,
        level: int,
        plates: Plates,
        u: NDArray[np.float64],
        tolerance: float,
        before: Held,
    ) -> State:
        """State of one of the bodies from a displacement near it, with friction if there is any."""

        def minimised(u: NDArray[np.float64], contact: Contact) -> State:
            return self._minimise(body, level, contact, gap_mm, u, tolerance)

        contact, gap_mm = self.contact(level, plates), plates.thickness_mm
        if before.grip is None:
            return minimised(u, contact)
        first = self._friction(level, plates, contact, before.u, before.grip)
        return held_by_friction(minimised, contact, self.friction, u, first, plates)

    def _friction(
        self, level: int, plates: Plates, contact: Contact, u: NDArray[np.float64], grip: Grip
    ) -> Friction:
        """Friction after the plates have moved from where they had that grip."""
        corner, edge = self._frame(level)
        reach = STICK_MM / edge
        places = self.points[level].places(u)
        carried = (grip.plates.carried(plates, corner + edge * places) - corner) / edge
        earlier = self.contact(level, grip.plates)
        anchor = anchors(earlier, contact, places, carried, reach * grip.slip)
        return Friction(grip.limit, earlier.depth(places)[1], anchor, reach)

    def _minimise(
        self,
        body: Body,
        level: int,
        contact: Contact,
        gap_mm: float,
        u: NDArray[np.float64],
        tolerance: float,
        unfolded: float = np.inf,
    ) -> State:
        edge = 2.0**level * float(self.mesh.nodes.spacing_mm[0])

        def watch(step: Step) -> None:
            row = np.zeros(1, HISTORY)
            row[0] = (
                len(self.rows), edge, gap_mm, step.out_of_balance, step.depth * edge,
                step.force * edge**2 * 1e-3, step.energy * edge**3 * 1e-3, step.smallest,
                step.cycles, step.length, step.error * edge,
            )  # fmt: skip
            self.rows.append(row[0])
            if self._watch:
                self._watch(row[0])

        return minimise(
            body, contact, u, tolerance, self._workspace, watch=watch, unfolded=unfolded
        )


def interpolated(u: NDArray[np.float64], coarse: Body, fine: Body) -> NDArray[np.float64]:
    """Displacement of a body from that of its coarsened one, each in its own lattice units."""
    whole = continued(u, coarse.nodes, layers=2)
    out, tissue = np.zeros((3, *fine.nodes.shape)), fine.nodes.astype(np.float64)
    add_interpolated(whole, fine.node_span, np.repeat(tissue[None], 3, axis=0), out)
    return 2.0 * out * fine.free


def _mean_modulus(body: Body) -> float:
    """Mean Young's modulus of the tissue that moves, kPa; 3 mu for nearly incompressible tissue."""
    moves = body.active & (body.free[2] > 0.0)
    return 3.0 * float(body.shear[moves].sum() / body.fraction[moves].sum())

"""Springs that stiffen, and weight, against answers known on paper; both solvers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from make_springs import half_ellipsoid
from scipy.optimize import brentq

from mammosim.compression.springs import SpringProblem, SpringState, relax, solve
from mammosim.compression.springs.measures import spring_measures

SOLVERS = {
    "multigrid": lambda problem, **more: solve(problem, 1e-6, **more),
    "relaxation": lambda problem, **more: relax(problem, limit=1e-9, **more),
}
both_solvers = pytest.mark.parametrize("solver", SOLVERS)

ENL = {4.5: 7.5, 15.0: 10.0, 45.0: 20.0}


def enl_of(modulus: np.ndarray) -> np.ndarray:
    """The thesis' Enl of nodes with its moduli; 7.5 for any other."""
    stiffening = np.where(modulus > 0, 7.5, 0.0).astype(np.float32)
    for kpa, enl in ENL.items():
        stiffening[modulus == np.float32(kpa)] = enl
    return stiffening


def with_stiffening(problem: SpringProblem) -> SpringProblem:
    return replace(problem, stiffening=enl_of(problem.modulus))


def hanging_column(moduli: list[float], weight: float) -> SpringProblem:
    """A chain of nodes along z, the topmost held, each pulled down by a weight."""
    modulus = np.zeros((3, 3, len(moduli) + 2), np.float32)
    modulus[1, 1, 1:-1] = moduli
    fixed = np.zeros(modulus.shape, bool)
    fixed[1, 1, -2] = True
    force = np.where(modulus > 0, np.float32(-weight), np.float32(0.0))
    return SpringProblem(
        modulus, fixed, -np.inf, np.inf, np.inf, (None, None, force), edge_radius=0.0
    )


def block_between_plates(n: int, modulus: float, squeeze: float) -> SpringProblem:
    """n x n x n nodes between plates, n odd, held by the one in the middle, which stays anyway."""
    block = np.zeros((n + 4, n + 4, n + 2), np.float32)
    block[2:-2, 2:-2, 1:-1] = modulus
    fixed = np.zeros(block.shape, bool)
    fixed[(n + 3) // 2, (n + 3) // 2, (n + 1) // 2] = True
    return SpringProblem(block, fixed, 1.0 + squeeze / 2, n - squeeze / 2, 0.5)


def lengthened(law, load: float) -> float:
    """Strain at which a spring along z bears a load."""
    return float(brentq(lambda e: law(e) * e - load, 0.0, 2.0))


@both_solvers
@pytest.mark.parametrize("exponential", [False, True])
def test_a_hanging_column_lengthens_by_its_own_weight(solver, exponential):
    problem = hanging_column([4.5] * 10, weight=0.12)
    if exponential:
        problem = with_stiffening(problem)
    state = SOLVERS[solver](problem)
    assert state.converged
    longer = np.diff(state.displacement[2][1, 1, 1:-1])
    enl = 7.5 if exponential else 0.0
    # The spring above the k lowest nodes bears their weight.
    expected = [
        lengthened(lambda e: 4.5 * np.exp(enl * e), 0.12 * k) for k in range(1, 10)
    ]  # fmt: skip
    # Single precision of moduli and weight.
    np.testing.assert_allclose(longer, expected, atol=3e-6)


@both_solvers
def test_a_series_of_two_materials_shares_its_length(solver):
    moduli = [4.5] * 5 + [15.0] * 6
    problem = with_stiffening(hanging_column(moduli, weight=0.0))
    problem.fixed[1, 1, 1] = True
    compressed = np.zeros(problem.modulus.shape)
    compressed[1, 1, 1:-1] = np.linspace(2.5, 0.0, 11)
    still = np.zeros_like(compressed)
    start = SpringState((still, still.copy(), compressed), False, 1.0,
                        np.zeros(0))  # fmt: skip
    state = SOLVERS[solver](problem, start=start)
    shorter = -np.diff(state.displacement[2][1, 1, 1:-1])

    def fat(load: float) -> float:
        return lengthened(lambda e: 4.5 * np.exp(7.5 * e), load)

    def gland(load: float) -> float:
        return lengthened(lambda e: 15.0 * np.exp(10.0 * e), load)

    # One load; 5 springs are fat's, the one between the two materials among them, 5 are gland's.
    load = brentq(lambda f: 5 * fat(f) + 5 * gland(f) - 2.5, 0.0, 100.0)
    np.testing.assert_allclose(shorter[:5], fat(load), atol=3e-6)
    np.testing.assert_allclose(shorter[5:], gland(load), atol=3e-6)


@both_solvers
def test_a_uniform_block_bears_what_its_springs_add_up_to(solver):
    """A layer has n^2 upright springs, 4 n (n - 1) to a side and 4 (n - 1)^2 across corners.

    Squeezed by lambda it widens by 1 / sqrt(lambda), so that all are at rest in their plane; each
    has its own strain, and so its own modulus.
    """
    n, modulus, squeeze = 7, 4.5, 1.2
    stretch = 1.0 - squeeze / (n - 1)
    state = SOLVERS[solver](problem := with_stiffening(block_between_plates(n, modulus, squeeze)))
    assert state.converged
    total = 0.0
    for across, number in ((0, n * n), (1, 4 * n * (n - 1)), (2, 4 * (n - 1) ** 2)):
        at_rest = np.sqrt(across / stretch + 1.0)
        strain = abs(np.sqrt(across / stretch + stretch**2) / at_rest - 1.0)
        total += number * modulus * np.exp(7.5 * strain) * (1.0 - stretch)
    force = spring_measures(problem, state, 1.0)["force_n"]
    # Single precision of the springs; the solvers' tolerance of 1e-6 of a spacing.
    assert force == pytest.approx(total / 9.0 * 1e-3, rel=1e-5)
    # The block is as wide as its cells want to be.
    ux = state.displacement[0][2:-2, 2:-2, 1:-1]
    np.testing.assert_allclose(np.diff(ux, axis=0), 1.0 / np.sqrt(stretch) - 1.0, atol=1e-5)


def test_a_uniform_block_of_linear_springs_counts_them():
    """Without stiffening the same sum is (3 n - 2)^2 springs, nine a node in the bulk."""
    n = 7
    counted = n * n + 4 * n * (n - 1) + 4 * (n - 1) ** 2
    assert counted == (3 * n - 2) ** 2


@both_solvers
def test_weight_rests_on_the_support(solver):
    problem = block_between_plates(5, 4.5, 0.0)
    # Held by a thread too soft to bear more than 1e-4 of the weight, beside the lowest layer.
    problem.fixed[:] = False
    problem.modulus[1, 4, 1], problem.fixed[1, 4, 1] = 1e-4, True
    force = np.where(problem.modulus > 1.0, np.float32(-0.01), np.float32(0.0))
    problem = with_stiffening(replace(problem, force=(None, None, force), upper=100.0))
    measures = spring_measures(problem, SOLVERS[solver](problem), 1.0)
    # In lattice units of kPa a force of F mN is 9 F / h^2.
    assert measures["support_force_n"] == pytest.approx(125 * 0.01 / 9.0 * 1e-3, rel=1e-4)
    assert measures["force_n"] == 0.0


@pytest.fixture(scope="module")
def breast() -> SpringProblem:
    return with_stiffening(half_ellipsoid(gap=0.7))


@pytest.fixture(scope="module")
def equilibrium(breast) -> SpringState:
    state = solve(breast, 1e-5)
    assert state.converged
    return state


def distance(a: SpringState, b: SpringState, problem: SpringProblem) -> float:
    """Largest distance of a tissue node between two states, lattice units."""
    gaps = [u - v for u, v in zip(a.displacement, b.displacement, strict=True)]
    return float(np.sqrt(sum(gap**2 for gap in gaps))[problem.tissue].max())


def test_solvers_agree_on_a_breast(breast, equilibrium):
    state = relax(breast, limit=1e-8)
    # 1e-8 a sweep with a contraction of about 0.99 leaves about 1e-6; the multigrid's 1e-5.
    assert distance(state, equilibrium, breast) < 1e-4


def test_the_error_is_about_what_is_left(breast, equilibrium):
    for tolerance in (1e-1, 1e-2, 1e-3):
        state = solve(breast, tolerance)
        assert state.error <= tolerance
        # An estimate from how steps shrink: within a factor of two.
        assert distance(state, equilibrium, breast) < 2.0 * tolerance


def test_equilibrium_does_not_depend_on_the_start(breast, equilibrium):
    tighter = solve(with_stiffening(half_ellipsoid(gap=0.6)), 1e-2)
    assert distance(solve(breast, 1e-5, start=tighter), equilibrium, breast) < 1e-4


@both_solvers
def test_a_breast_at_rest_stays(solver, breast):
    state = SOLVERS[solver](breast.released())
    assert state.converged
    assert max(np.abs(u[breast.tissue]).max() for u in state.displacement) < 1e-12


@both_solvers
def test_decompression_returns_to_rest(solver, breast, equilibrium):
    state = SOLVERS[solver](breast.released(), start=equilibrium)
    assert state.converged
    assert max(np.abs(u[breast.tissue]).max() for u in state.displacement) < 1e-4


def test_a_symmetric_breast_stays_symmetric(equilibrium):
    ux, uy, uz = equilibrium.displacement
    # The solver's tolerance, a few times over.
    np.testing.assert_allclose(ux, ux[:, ::-1], atol=1e-4)
    np.testing.assert_allclose(uy, -uy[:, ::-1], atol=1e-4)
    np.testing.assert_allclose(uz, -uz[:, :, ::-1], atol=1e-4)


def test_stiffening_springs_bear_more(breast, equilibrium):
    linear = replace(breast, stiffening=None)
    force = [
        spring_measures(problem, state, 1.0)["force_n"]
        for problem, state in ((linear, solve(linear, 1e-4)), (breast, equilibrium))
    ]
    # At 30 % compression fat is exp(7.5 * 0.3) = 9 times stiffer along z, its diagonals less.
    assert 2.0 * force[0] < force[1] < 9.0 * force[0]


def test_an_interrupted_solution_keeps_what_it_reached(breast):
    def stop(row: np.void) -> None:
        if row["iteration"] > 30:
            raise KeyboardInterrupt

    state = solve(breast, 1e-6, watch=stop)
    assert state.interrupted
    assert not state.converged
    assert state.history.size == 32

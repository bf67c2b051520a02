"""Laws of the photon transport."""

import numba
import numpy as np
import pytest
from naive import monte_carlo as naive
from naive.projection import turned_pixel

from mammosim.acquisition.attenuation import (
    BEAM_MATERIALS,
    attenuation_per_mm,
    cross_section_cm2_g,
)
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.monte_carlo import (
    Grid,
    Guide,
    absorbed_energy,
    dose_map_mgy,
    photon_tables,
    smoothed,
    smoothed_scatter,
)
from mammosim.acquisition.monte_carlo.compton import (
    impulse_function,
    scattering_function,
    shells_of,
)
from mammosim.acquisition.monte_carlo.tables import angular_densities
from mammosim.errors import InputError
from mammosim.tissues import Material

GLAND, ADIPOSE = naive.MATERIALS["gland"], naive.MATERIALS["adipose"]
CLIP = naive.MATERIALS["titanium"]
S = np.linspace(0.0, 1.0, 257)


def slab(thickness_mm=20.0, **keys):
    return naive.block((30.0, 40.0, thickness_mm), (0.0, -20.0, 0.0), **keys)


# What is sampled against integrals


@pytest.mark.parametrize("material", [GLAND, ADIPOSE, BEAM_MATERIALS["polycarbonate"], CLIP])
def test_angular_distributions_give_back_the_total_cross_sections(material):
    """Integrals of form factors and scattering functions against xraylib's own totals."""
    tables = photon_tables([material], 12.0, 30.0)
    np.testing.assert_allclose(
        tables.total[:, 0], attenuation_per_mm(material, tables.energy_kev), rtol=1e-12
    )
    densities = angular_densities(material, tables.energy_kev)
    # r_e^2/2 times 8 pi s ds, 1/(g mol) -> cm2/g -> 1/mm
    unit = 0.5 * 0.0794078 * 0.602214 * 8.0 * np.pi * 0.1 * material.density_g_cm3
    incoherent, coherent = (unit * np.trapezoid(part, S, axis=1) for part in densities)
    # both were scaled together so that the sum over all processes is the primary's: 1 %
    np.testing.assert_allclose(
        incoherent / coherent, tables.incoherent[:, 0] / tables.coherent[:, 0], rtol=0.01
    )
    beam = tables.energy_kev >= 12.0
    for name, integral, close in (("CS_Compt", incoherent, 0.05), ("CS_Rayl", coherent, 0.01)):
        known = cross_section_cm2_g(name, material, tables.energy_kev)
        # form factors: 0.6 % in tissue, 1 % in titanium, two evaluations of one theory; Compton:
        # impulse approximation against Waller and Hartree's, 2 to 4 % above 12 keV
        np.testing.assert_allclose(
            integral[beam], 0.1 * material.density_g_cm3 * known[beam], rtol=close, err_msg=name
        )


def test_one_parameter_profiles_stand_for_those_of_biggs_mendelsohn_and_mann():
    energy, cosine = 20.0, np.cos(np.radians([20.0, 45.0, 90.0, 150.0]))
    found = scattering_function(ADIPOSE, np.array([energy]), cosine)[0]
    expected = [
        naive.electrons_that_scatter(energy, c, ADIPOSE.density_g_cm3, ADIPOSE.mass_fraction)
        for c in cosine
    ]
    # the shape of each profile, and 0.1 % of heavier elements' electrons, that the twin leaves out
    np.testing.assert_allclose(found, expected, rtol=0.02)


def test_compton_scattering_of_polystyrene_is_that_of_penelope():
    """54.04 mm between Compton events at 16.8 keV: PENELOPE 2006, table of MC-GPU."""
    energy, s = np.array([16.8]), np.linspace(0.0, 1.0, 1001)
    cosine = 1.0 - 2.0 * s**2
    electrons = sum(
        fraction / weight * impulse_function(shells_of(symbol), energy, cosine)[0]
        for symbol, fraction, weight in (("C", 0.922582, 12.011), ("H", 0.077418, 1.008))
    )
    ratio = 1.0 / (1.0 + energy / 510.999 * (1.0 - cosine))
    section = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2) * electrons * s
    per_mm = np.trapezoid(section, s) * 4.0 * np.pi * 0.0794078 * 0.602214 * 0.106
    # PENELOPE has ionisation energies of free atoms in place of xraylib's: 0.3 %
    assert 1.0 / per_mm == pytest.approx(54.04, rel=0.005)


@pytest.mark.parametrize("material", [GLAND, ADIPOSE, CLIP])
def test_sampled_angles_have_the_moments_of_their_densities(material):
    """Equal steps of probability give back means of cosine, its square, and the energy lost."""
    tables = photon_tables([material], 12.0, 30.0)
    cosine = 1.0 - 2.0 * S**2
    sampled = (tables.incoherent_cosine[:, 0], tables.coherent_cosine[:, 0])
    for density, nodes in zip(angular_densities(material, tables.energy_kev), sampled, strict=True):
        u = (np.arange(20000) + 0.5) / 20000 * (nodes.shape[1] - 1)
        low = u.astype(int)
        drawn = nodes[:, low] + (u - low) * (nodes[:, low + 1] - nodes[:, low])
        for power in (1, 2):
            mean = np.trapezoid(density * cosine**power, S, axis=1) / np.trapezoid(
                density, S, axis=1
            )
            # straight lines between 128 steps
            np.testing.assert_allclose((drawn**power).mean(axis=1), mean, atol=1e-3)
    nodes = tables.incoherent_cosine[:, 0].astype(float)
    lost = 1.0 - 1.0 / (1.0 + tables.energy_kev[:, None] / 510.999 * (1.0 - nodes))
    mean = np.trapezoid(lost, axis=1) / (nodes.shape[1] - 1)
    np.testing.assert_allclose(mean, tables.transfer[:, 0], rtol=1e-3)


@pytest.mark.parametrize(
    "turned",
    [
        {},
        {"gap_mm": 30.0, "tube_angle_deg": 20.0, "detector_angle_deg": 12.0,
         "pivot_to_detector_mm": 20.0},
    ],
    ids=["upright", "turned"],
)  # fmt: skip
def test_single_scatter_of_a_small_cube_is_its_integral(turned):
    """A cube so thin that nearly all scatter once, in a beam of one energy."""
    thin, centre = 0.02, (30.0, 0.0, 21.0)
    cube = naive.block((2.0, 2.0, 2.0), (29.0, -1.0, 20.0), density=thin)
    case = naive.Case(cube, naive.gantry(120, 100, **turned))
    shadow = case.gantry.detector_xy_mm(*case.gantry.project(centre))
    field = naive.pencil(*shadow, 3.5 if turned else 2.6)  # of 2.1 mm, and wider where oblique
    alone = case.follow(16 * 2000, field=field)
    empty = naive.Case(
        naive.block((2.0, 2.0, 2.0), (29.0, -1.0, 20.0), eighths=(0,)), case.gantry
    ).follow(16 * 2000, field=field)
    m = alone.margin
    found = (alone.scatter - empty.scatter).mean(axis=0)[m:-m, m:-m]
    error = (alone.scatter - empty.scatter).std(axis=0, ddof=1)[m:-m, m:-m] / 4.0
    row, column = 2.0 * np.arange(60) + 0.5, 2.0 * np.arange(50) + 0.5
    cells = turned_pixel(case.gantry, *np.meshgrid(row, column, indexing="ij"))
    expected = naive.single_scatter(case, centre, 8.0 * thin, cells, 20.0)
    away = np.hypot(cells[..., 0] - 30.0, cells[..., 1])
    near = away < 25.0
    ring = near & (away > 12.0)
    for part in (near, ring, ring & (cells[..., 1] < 0.0)):
        # attenuation in cube and air 0.5 %; four standard errors of the sum
        total = np.sqrt((error[part] ** 2).sum())
        assert found[part].sum() == pytest.approx(expected[part].sum(), rel=0.01, abs=4.0 * total)


# Conservation


def test_energy_is_conserved_exactly_in_analog_mode():
    case = naive.Case(slab(), layers=naive.plates(3.0, 1.0), energy_kev=(15.0, 20.0, 25.0))
    emitted, detected, escaped, deposited = case.follow(16 * 500, analog=True).ledger.T
    np.testing.assert_allclose(escaped + deposited, emitted, rtol=1e-12)  # sums of 500
    assert (detected < escaped).all()
    assert (detected > 0.0).all()


def test_energy_is_conserved_in_expectation_otherwise():
    case = naive.Case(slab(), layers=naive.plates(3.0, 1.0), energy_kev=(15.0, 20.0, 25.0))
    tallies = case.follow(16 * 2000)
    balance = (tallies.ledger[:, 2] + case.deposited_kev(tallies)) / tallies.ledger[:, 0]
    error = balance.std(ddof=1) / 4.0
    assert error < 0.002
    # five standard errors; sections in 32 bits
    assert balance.mean() == pytest.approx(1.0, abs=5.0 * error + 1e-5)


def test_weighted_and_analog_photons_agree():
    case = naive.Case(slab(), layers=naive.plates(3.0, 1.0), energy_kev=(15.0, 20.0, 25.0))
    weighted, analog = case.follow(16 * 2000), case.follow(16 * 20000, seed=2, analog=True)
    for part in (1, 2):
        means = [tallies.ledger[:, part].mean() for tallies in (weighted, analog)]
        error = np.hypot(*(t.ledger[:, part].std(ddof=1) / 4.0 for t in (weighted, analog)))
        assert error < 0.03 * means[0]
        assert means[0] == pytest.approx(means[1], abs=4.0 * error)


def test_without_tissue_and_plates_only_air_scatters():
    """35 mm of air scatter 0.1 % of the photons; part of them meets the detector."""
    case = naive.Case(slab(eighths=(0,)))
    emitted, detected, escaped, _ = case.follow(16 * 500).ledger.mean(axis=0)
    assert 0.0 < detected < 1e-3 * emitted
    assert escaped == pytest.approx(emitted, rel=5e-3)


# Precision


def test_the_same_bits_for_any_number_of_threads():
    case = naive.Case(slab(), layers=naive.plates(3.0, 1.0))
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = case.follow(16 * 100, grid=Grid(), mapped=True)
    finally:
        numba.set_num_threads(threads)
    together = case.follow(16 * 100, grid=Grid(), mapped=True)
    for name in ("scatter", "behind_grid", "collisions", "ledger", "energy_map"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(together, name))
    assert (case.follow(16 * 100, seed=2).scatter != alone.scatter).any()


def test_the_estimate_of_its_own_noise_is_right_over_100_seeds():
    case = naive.Case(slab(10.0))
    runs = []
    for seed in range(100):
        tallies = case.follow(16 * 40, seed=seed)
        rows, columns = tallies.scatter.shape[1:]
        # below the breast and beside it, along a shape that falls to one side
        shape = np.tile(np.linspace(2.0, 1.0, columns), (rows, 1))
        below = np.tile(np.arange(columns) < columns // 2, (rows, 1))
        guide = Guide(shape, below, 2.0)
        runs.append(smoothed_scatter(tallies.scatter, tallies.margin, guide))
    means, errors = (np.stack(part)[:, 8:22, 3:14] for part in zip(*runs, strict=True))
    actual = means.var(axis=0, ddof=1).mean()
    # about 15 independent places and 100 seeds: 4 % of a variance, and 5 % of the estimate
    assert (errors**2).mean() == pytest.approx(actual, rel=0.2)


def test_four_times_the_photons_halve_the_noise():
    """And no more or less is detected: the photons' number is in the statistics alone."""
    case = naive.Case(slab(10.0))
    few, many = (case.follow(16 * photons) for photons in (100, 400))
    assert (few.photons, many.photons) == (1600, 6400)
    deviation = [t.scatter.std(axis=0, ddof=1).mean() / 4.0 for t in (few, many)]
    assert deviation[0] / deviation[1] == pytest.approx(2.0, rel=0.25)
    means = [t.ledger[:, 1].mean() for t in (few, many)]
    error = np.hypot(*(t.ledger[:, 1].std(ddof=1) / 4.0 for t in (few, many)))
    assert means[0] == pytest.approx(means[1], abs=4.0 * error)


def test_smoothing_gives_back_the_shape_it_is_guided_by():
    """No leak over the breast's edge, whatever the step there is."""
    column = np.arange(30)
    shape = np.tile(np.exp(-column / 8.0), (20, 1))
    below = np.tile(column < 14, (20, 1))
    truth = np.where(below, 3.0, 0.2) * shape
    found = smoothed(truth[None], Guide(shape, below, 2.0))[0]
    np.testing.assert_allclose(found, truth, rtol=1e-9)


def test_half_the_spacing_leaves_the_scatter_as_it_was():
    """A homogeneous block is the same scene with any spacing, and its photons the same."""
    whole, half = (
        naive.Case(slab(voxel_mm=step), layers=naive.plates(3.0, 1.0)).follow(16 * 500)
        for step in (1.0, 0.5)
    )
    # exp by a polynomial, planes rounded; nothing else may depend on the spacing
    np.testing.assert_allclose(
        half.scatter.sum(axis=(1, 2)), whole.scatter.sum(axis=(1, 2)), rtol=1e-5
    )
    np.testing.assert_allclose(half.collisions.sum(), whole.collisions.sum(), rtol=1e-5)


# Grid, detector and dose


def test_scatter_falls_with_the_air_gap():
    """Towards that of a point source in the far field, which goes with the square of distance."""
    found = []
    for gap_mm in (15.0, 30.0, 100.0, 290.0):
        case = naive.Case(slab(), naive.gantry(60, 40, gap_mm=gap_mm))
        tallies = case.follow(16 * 500)
        m = tallies.margin
        found.append(tallies.scatter.mean(axis=0)[m:-m, m:-m][12:18, 5:12].mean())
    assert found[0] > 1.2 * found[1] > 3.0 * found[2] > 9.0 * found[3] > 0.0


def test_the_grid_lets_through_what_its_geometry_says():
    grid = Grid()
    energy, straight = np.array([19.0]), np.ones(1)
    open_part = 1.0 - grid.strip_mm / grid.period_mm
    # VICTRE's mean free path in polystyrene at 19 keV, 19.616 mm
    expected = open_part * np.exp(-grid.height_mm / 19.616)
    assert grid.transmission(energy, straight, np.zeros(1))[0, 0, 0] == pytest.approx(
        expected, rel=0.01
    )
    tangent = np.array([0.0, 0.05, 0.1, 0.15, 0.3])
    along = grid.transmission(energy, straight, tangent)[0, 0]
    assert (np.diff(along[:4]) < 0.0).all()
    # shadow of the strips: linear up to the tangent 1/ratio where no way is open
    np.testing.assert_allclose(along[:4] / along[0], 1.0 - tangent[:4] * grid.ratio, atol=0.02)
    assert along[4] < 0.02


def test_oblique_photons_are_absorbed_along_a_longer_way():
    selenium = find_detector("a-Se-70")
    found = selenium.oblique_efficiency(np.array([25.0]), np.array([1.0, 0.5]))[0]
    assert found[0] == pytest.approx(selenium.efficiency(np.array([25.0]))[0])
    assert found[0] < found[1] < 1.0
    slope = (
        selenium.oblique_efficiency(np.array([25.0]), np.array([1.0 / 1.001]))[0, 0] / found[0]
        - 1.0
    ) / 1e-3
    # the second order of 0.001
    assert selenium.oblique_gain(np.array([25.0]))[0] == pytest.approx(slope, rel=2e-3)


def test_dose_of_the_materials_of_one_mixture_and_its_map():
    """Both materials of a mixture see the same photons; the map adds up to the same energy."""
    case = naive.Case(slab(materials=("gland", "adipose"), eighths=(4, 4)), energy_kev=(20.0,))
    tallies = case.follow(16 * 500, mapped=True)
    absorbed = absorbed_energy(tallies, case.scene, case.tables)
    gland, adipose = (absorbed.dose_mgy(name)[0] for name in ("gland", "adipose"))
    kerma = [
        case.tables.absorbed[-1, column] / material.density_g_cm3
        for column, material in enumerate((GLAND, ADIPOSE))
    ]
    # most photons still have their first energy; the ratio hardly depends on it
    assert gland / adipose == pytest.approx(kerma[0] / kerma[1], rel=0.01)
    assert np.isnan(absorbed.dose_mgy("muscle")[0])
    dose = dose_map_mgy(tallies, case.scene)
    grams = 0.5 * (GLAND.density_g_cm3 + ADIPOSE.density_g_cm3) * 1e-3
    mean = (gland * GLAND.density_g_cm3 + adipose * ADIPOSE.density_g_cm3) * 0.5e-3 / grams
    assert dose.mean() == pytest.approx(mean, rel=1e-4)  # sums in 32 bits
    assert dose[..., -1].mean() > 3.0 * dose[..., 0].mean()


# What cannot be computed


def test_an_element_without_tables_is_refused():
    unknown = Material("mass", 1.0, {"Rf": 1.0}, "")
    with pytest.raises(InputError, match="element 'Rf' has no scattering tables"):
        angular_densities(unknown, np.array([20.0]))


def test_a_spectrum_beyond_the_tables_is_refused():
    with pytest.raises(InputError, match=r"photons of 0.5 to 28 keV, the scattering tables cover"):
        photon_tables([GLAND], 0.5, 28.0)
    with pytest.raises(InputError, match=r"photons of 10 to 160 keV"):
        photon_tables([GLAND], 10.0, 160.0)

import numpy as np
import pytest

from mammosim.acquisition import AcquisitionSettings, check_acquisition
from mammosim.acquisition.attenuation import (
    BEAM_MATERIALS,
    absorbed_fraction,
    attenuation_per_mm,
    energy_absorption_cm2_g,
)
from mammosim.errors import InputError
from mammosim.tissues import (
    CALCIFICATIONS,
    COMPOSITION_SETS,
    MATERIAL_NAMES,
    TISSUES,
    composition,
)

ENERGIES = np.array([18.0, 20.0, 25.0, 30.0])

# 1/cm at 18, 20, 25, 30 keV, tabulated with xraylib 4 when the models were chosen.
REFERENCE = {
    ("hammerstein", "adipose"): (0.6364, 0.5131, 0.3520, 0.2804),
    ("hammerstein", "gland"): (1.0254, 0.8005, 0.5073, 0.3779),
    ("hammerstein", "skin"): (1.0992, 0.8568, 0.5405, 0.4009),
    ("icru44", "adipose"): (0.6711, 0.5394, 0.3675, 0.2910),
    ("icru44", "muscle"): (1.1086, 0.8617, 0.5395, 0.3973),
    ("icru44", "blood"): (1.1513, 0.8935, 0.5570, 0.4083),
}
CALCIFICATION_REFERENCE = {
    "oxalate": (12.23, 9.094, 4.905, 3.021),
    "carbonate": (20.83, 15.44, 8.242, 5.002),
    "hydroxyapatite": (28.02, 20.73, 11.00, 6.633),
}


@pytest.mark.parametrize(("which", "material"), REFERENCE)
def test_attenuation_of_tissues(which, material):
    found = attenuation_per_mm(composition(which, "oxalate")[material], ENERGIES) * 10.0
    # 5e-4 is half a unit of the last digit of the smallest reference value
    np.testing.assert_allclose(found, REFERENCE[which, material], rtol=5e-4)


@pytest.mark.parametrize("name", CALCIFICATIONS)
def test_attenuation_of_calcifications(name):
    found = attenuation_per_mm(composition("icru44", name)["calcification"], ENERGIES) * 10.0
    np.testing.assert_allclose(found, CALCIFICATION_REFERENCE[name], rtol=5e-4)


def test_carbon_and_oxygen_agree_with_xcom():
    """NIST XCOM at 20 keV: 0.4420 and 0.8651 cm2/g; the Kissel tables have half of it."""
    carbon = BEAM_MATERIALS["carbon fibre"]
    found = attenuation_per_mm(carbon, np.array([20.0])) * 10.0 / carbon.density_g_cm3
    np.testing.assert_allclose(found, 0.4420, rtol=5e-3)  # two evaluations of the same data


def test_energy_absorption_of_air_agrees_with_nist():
    """NIST (Hubbell & Seltzer 1995) mu_en/rho of dry air at 10, 15, 20, 30 keV, cm2/g."""
    found = energy_absorption_cm2_g(BEAM_MATERIALS["air"], np.array([10.0, 15.0, 20.0, 30.0]))
    # 1 per cent: argon's escaping fluorescence is left out, cross-sections are another evaluation
    np.testing.assert_allclose(found, [4.742, 1.334, 0.5389, 0.1537], rtol=1e-2)


def test_thick_layer_absorbs_all_but_scatter():
    selenium = BEAM_MATERIALS["Se"]
    thin = absorbed_fraction(selenium, np.array([1e-6]), ENERGIES)[:, 0]
    thick = absorbed_fraction(selenium, np.array([100.0]), ENERGIES)[:, 0]
    assert np.all(thin < 1e-3)
    assert np.all((thick > 0.9) & (thick < 1.0))


@pytest.mark.parametrize("which", COMPOSITION_SETS)
def test_every_set_names_every_material_of_the_tissue_table(which):
    materials = composition(which, "carbonate")
    assert set(materials) == set(MATERIAL_NAMES)
    assert {t.material for t in TISSUES.values() if t.material} == set(MATERIAL_NAMES)
    for material in materials.values():
        assert sum(material.mass_fraction.values()) == pytest.approx(1.0, abs=1e-12)
        assert material.source


@pytest.mark.parametrize("which", COMPOSITION_SETS)
def test_mass_is_gland_at_its_own_density(which):
    materials = composition(which, "carbonate")
    assert materials["mass"].mass_fraction == materials["gland"].mass_fraction
    assert materials["mass"].density_g_cm3 == 1.06


def test_own_composition_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("adipose: {density_g_cm3: 0.9, mass_percent: {C: 80, H: 20}, source: me}\n")
    materials = composition(str(path), "oxalate")
    assert materials["adipose"].mass_fraction == {"C": 0.8, "H": 0.2}
    assert materials["gland"] == composition("hammerstein", "oxalate")["gland"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fat: {density_g_cm3: 1, mass_percent: {C: 100}}", "unknown material 'fat'"),
        ("adipose: 3", "adipose: expected density_g_cm3 and mass_percent"),
        ("adipose: {density_g_cm3: -1, mass_percent: {C: 100}}", "density_g_cm3: found -1"),
        ("adipose: {density_g_cm3: 1, mass_percent: {C: x}}", "expected 'element: per cent'"),
        ("adipose: {density_g_cm3: 1, mass_percent: {C: 60}}", "adds up to 60, expected 100"),
        ("adipose: {density_g_cm3: 1, mass_percent: {1: 60, C: 40}}", "found the element 1"),
        ("adipose: {density_g_cm3: 1, mass_percent: {'': 100}}", "found the element ''"),
        ("[]", "expected blocks of"),
    ],
)
def test_faulty_composition_files(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        composition(str(path), "oxalate")


def test_unknown_element(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("adipose: {density_g_cm3: 1, mass_percent: {Xx: 100}}")
    with pytest.raises(InputError, match="unknown element 'Xx'"):
        attenuation_per_mm(composition(str(path), "oxalate")["adipose"], ENERGIES)


@pytest.mark.parametrize("scatter", [True, False])
def test_what_has_no_tables_is_refused_before_anything_is_computed(scatter, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("adipose: {density_g_cm3: 1, mass_percent: {C: 99, Rf: 1}}")
    settings = AcquisitionSettings(scatter=scatter, composition=str(path), kvp=28.0)
    with pytest.raises(InputError, match=r"element 'Rf' has no cross-sections from .* to .* keV"):
        check_acquisition(settings)


def test_unknown_names():
    with pytest.raises(InputError, match=r"acquisition.composition: found 'icru', expected one of"):
        composition("icru", "oxalate")
    with pytest.raises(InputError, match=r"acquisition.calcification: found 'chalk'"):
        composition("icru44", "chalk")

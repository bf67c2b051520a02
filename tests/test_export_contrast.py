"""Files of a mammogram with a contrast agent."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pydicom
import pytest
import tifffile
from make_records import make_mammogram
from make_run import invoke, save_breast, write

from mammosim.acquisition.mammogram import ContrastPair, IodineImage
from mammosim.acquisition.settings import ContrastSettings
from mammosim.export import ExportSettings, StudyIdentity
from mammosim.export.contrast import write_contrast
from mammosim.export.dicom import mammogram_dataset
from mammosim.geometry import View

VIEW = View("MLO", "R")
STUDY = StudyIdentity("77" * 32)


@pytest.fixture(scope="module")
def mammogram():
    low = make_mammogram(VIEW)
    high = replace(make_mammogram(VIEW, seed=2), kvp=49.0, filter="Cu", filter_mm=0.3, mas=120.0)
    iodine = np.linspace(-1.0, 8.0, low.for_processing.size, dtype=np.float32)
    iodine = iodine.reshape(low.for_processing.shape)
    image = IodineImage(iodine, iodine + np.float32(0.5), 0.25, 0.015)
    return replace(low, contrast=ContrastPair(high, image))


@pytest.fixture(scope="module")
def folder(mammogram, tmp_path_factory):
    path = tmp_path_factory.mktemp("RMLO")
    write_contrast(mammogram, path, STUDY, ExportSettings())
    return path


def test_both_are_there_and_only_with_an_agent(folder, tmp_path):
    names = {"high_energy.dcm", "recombined.dcm", "iodine.tif"}
    assert {path.name for path in folder.iterdir()} == names
    write_contrast(make_mammogram(VIEW), tmp_path, STUDY, ExportSettings())
    assert list(tmp_path.iterdir()) == []


def test_iodine_is_kept_in_mg_cm2(folder, mammogram):
    iodine = mammogram.contrast.iodine.mg_cm2
    np.testing.assert_array_equal(tifffile.imread(folder / "iodine.tif"), iodine)
    shown = pydicom.dcmread(folder / "recombined.dcm").pixel_array.astype(float)
    np.testing.assert_allclose(
        (shown - 2000) / 400, np.minimum(iodine + 0.5, 2095 / 400), atol=0.0013
    )


def test_image_type_says_energy_and_subtraction(folder, mammogram):
    high, iodine = (pydicom.dcmread(folder / f"{n}.dcm") for n in ("high_energy", "recombined"))
    low = mammogram_dataset(mammogram, "processing", STUDY, ExportSettings())
    assert list(low.ImageType) == ["ORIGINAL", "PRIMARY", "", "", "LOW_ENERGY"]
    assert list(high.ImageType) == ["ORIGINAL", "PRIMARY", "", "", "HIGH_ENERGY"]
    assert list(iodine.ImageType)[:4] == ["DERIVED", "PRIMARY", "", "SUBTRACTION"]
    assert (high.KVP, high.FilterMaterial, low.FilterMaterial) == (49, "COPPER", "RHODIUM")
    assert {one.ContrastBolusIngredient for one in (low, high, iodine)} == {"IODINE"}
    series = {one.SeriesInstanceUID for one in (low, high, iodine)}
    objects = {one.SOPInstanceUID for one in (low, high, iodine)}
    assert (len(series), len(objects)) == (3, 3)
    sources = [item.ReferencedSOPInstanceUID for item in iodine.SourceImageSequence]
    assert sources == [low.SOPInstanceUID, high.SOPInstanceUID]
    assert high.IrradiationEventUID != low.IrradiationEventUID


def test_an_implant_is_said(mammogram):
    with_implant = replace(mammogram, implant=True)
    made = mammogram_dataset(with_implant, "presentation", STUDY, ExportSettings())
    assert made.BreastImplantPresent == "YES"


@pytest.mark.skipif(shutil.which("dciodvfy") is None, reason="dciodvfy is not installed")
@pytest.mark.parametrize("name", ["high_energy", "recombined"])
def test_dciodvfy_finds_no_error(folder, name):
    said = subprocess.run(
        ["dciodvfy", str(folder / f"{name}.dcm")], capture_output=True, text=True, check=False
    )
    assert "Error" not in said.stdout + said.stderr


def test_a_series_of_projections_takes_no_agent(tmp_path):
    save_breast(tmp_path)
    path = write(
        tmp_path, views=[{"dbt": {"view": "CC"}}], acquisition={"contrast": {"filter": "Ti"}}
    )
    result = invoke("check", path)
    assert result.exit_code == 2
    said = " ".join(result.output.split())
    assert "CC_DBT: acquisition.contrast is for mammograms, not for a series" in said


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kvp": 30.0}, "greater than or equal to 34"),
        ({"filter": "Pb"}, "expected one of Mo, Rh, Ag, Al, Cu, Ti"),
        ({"lesion_mg_ml": -1.0}, "greater than or equal to 0"),
    ],
)
def test_agents_that_cannot_be(keys, message):
    with pytest.raises(ValueError, match=message):
        ContrastSettings(**keys)

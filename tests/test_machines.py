"""Another machine rounds otherwise: what that changes, and what notices if it changes too much."""

from __future__ import annotations

import json
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from make_phantom import half_ellipsoid_breast
from make_run import FEW_PHOTONS, invoke

from mammosim.compression import compress
from mammosim.config import write_yaml
from mammosim.tissues import stiffness_kpa

BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "machines.py"
MACHINES = runpy.run_path(str(BENCHMARK))

STATED_CELLS = 2e-3
"""Two results, each at most `tolerance_voxel` (1e-3) from equilibrium; stated in reliability.md."""

CONFIGURATION = {
    "phantom": {
        "generate": {"density": "dense", "volume_ml": 160, "voxel_mm": 4.0},
        "lesions": [{"name": "mass", "kind": "mass", "diameter_mm": 16}],
    },
    "compression": {"model": "springs", "resolution_mm": 6},
    "projection": {"pixel_mm": 1.5},
    "acquisition": FEW_PHOTONS,
    "export": {"path_lengths": True},
    "report": {"html": False},
    "views": ["CC"],
    "seed": 5,
}


@pytest.mark.parametrize(("model", "resolution_mm"), [("springs", 3.0), ("hyperelastic", 5.0)])
def test_last_digits_of_the_moduli_do_not_decide(model, resolution_mm):
    """What a solver does with the smallest change of its input, it does with other rounding."""
    breast = half_ellipsoid_breast()
    changed = {}
    for name, towards in (("adipose", np.inf), ("gland", 0.0), ("skin", np.inf)):
        value = np.float32(stiffness_kpa(name, "thesis"))
        changed[name] = float(np.nextafter(value, np.float32(towards)))
    keys = {
        "view": "CC", "model": model, "resolution_mm": resolution_mm, "thickness_mm": 36.0,
        "stiffness": "thesis",
    }  # fmt: skip
    one = compress(breast, **keys).field
    other = compress(breast, stiffness_kpa=changed, **keys).field
    gap = np.linalg.norm(one.displacement_mm - other.displacement_mm, axis=-1)[one.tissue]
    assert 0.0 < gap.max() / resolution_mm < STATED_CELLS


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run on this machine as it is."""
    folder = tmp_path_factory.mktemp("machines")
    write_yaml(CONFIGURATION, folder / "run.yaml")
    assert invoke("run", folder / "run.yaml", "--output", folder / "run").exit_code == 0
    return folder / "run"


def test_other_functions_of_numpy_the_c_library_and_blas(run, tmp_path):
    """The same breast, and a run within the tolerance, where libraries choose older code."""
    older = {**os.environ}
    for choice in ("OLD_NUMPY", "OLD_LIBRARY", "OLD_BLAS"):
        older |= MACHINES[choice]
    command = [sys.executable, "-m", "mammosim", "run", run.parent / "run.yaml"]
    subprocess.run([*command, "--output", tmp_path / "older"], env=older, check=True)
    differences = list(MACHINES["compare"](run, tmp_path / "older"))
    assert len(differences) > 10
    assert not [str(found) for found in differences if found.beyond]


def test_the_comparison_notices_a_moved_node(run, tmp_path, capsys, monkeypatch):
    moved = tmp_path / "moved"
    shutil.copytree(run, moved)
    assert status_of(run, moved, monkeypatch) == 0
    for cells, status in ((1e-3, 0), (3e-3, 1)):
        shift_one_node(run, moved, cells * CONFIGURATION["compression"]["resolution_mm"])
        assert status_of(run, moved, monkeypatch) == status
    [beyond] = [line for line in capsys.readouterr().out.splitlines() if "BEYOND" in line]
    assert "displacement" in beyond


def test_the_comparison_refuses_another_configuration(run, tmp_path, monkeypatch):
    other = tmp_path / "other"
    shutil.copytree(run, other)
    record = json.loads((other / "run.json").read_text())
    (other / "run.json").write_text(json.dumps({**record, "run_hash": "another"}))
    assert "different configurations" in status_of(run, other, monkeypatch)


def status_of(first: Path, second: Path, monkeypatch) -> int | str:
    """Exit status or message of the benchmark's `--compare`."""
    monkeypatch.setattr(sys, "argv", [str(BENCHMARK), "--compare", str(first), str(second)])
    with pytest.raises(SystemExit) as stop:
        MACHINES["main"]()
    return stop.value.code


def shift_one_node(source: Path, target: Path, by_mm: float) -> None:
    """Write the displacement of a run anew, one node in the tissue moved along."""
    field, lattice = (
        sitk.ReadImage(str(source / "LCC" / name))
        for name in ("displacement.nii.gz", "lattice.nii.gz")
    )
    vectors = sitk.GetArrayFromImage(field)
    vectors[tuple(np.argwhere(sitk.GetArrayFromImage(lattice))[0])][0] += by_mm
    moved = sitk.GetImageFromArray(vectors, isVector=True)
    moved.CopyInformation(field)
    sitk.WriteImage(moved, str(target / "LCC" / "displacement.nii.gz"))

"""The command line as a user meets it: files, tables, messages, exit status."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from make_run import SMALL, invoke, save_breast, write

import mammosim
from mammosim import load_config, simulate
from mammosim.errors import InputError
from mammosim.targets import Target


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with a small phantom of the user's own."""
    return save_breast(tmp_path_factory.mktemp("user"))


@pytest.fixture(scope="module")
def finished(folder) -> Path:
    """A finished run of it."""
    output = folder / "out"
    result = invoke("run", write(folder), "--output", output)
    assert result.exit_code == 0, result.output
    return output


def test_a_run_leaves_every_file_of_the_contract(finished):
    found = {
        str(path.relative_to(finished))
        for path in finished.rglob("*")
        if path.is_file() and path.parent.name != ".stages"
    }
    view = {
        "for_processing.dcm", "for_presentation.dcm", "for_presentation.png",
        "mammogram.tif", "preview.png",
        "lesion_mask.dcm", "lesion_mask.tif", "lesion_measurements.dcm", "lesion_outlines.dcm",
        "compressed.nii.gz", "displacement.nii.gz",
        "convergence.csv", "compression.json", "lattice.nii.gz", "geometry.json",
        "labels.json", "labels.ctbl",
    }  # fmt: skip
    expected = {"run.json", "config.yaml", "lesions.csv", "view_rules.csv", "report.html"}
    expected |= {"uncompressed.nii.gz", "labels.json", "labels.ctbl"}
    expected |= {f"{name}/{file}" for name in ("LCC", "LMLO") for file in view}
    assert found == expected


def test_the_table_has_a_row_a_target_and_view(finished):
    rows = list(csv.DictReader((finished / "lesions.csv").open()))
    assert list(rows[0]) == list(Target.__dataclass_fields__)
    assert [(row["name"], row["kind"]) for row in rows[:3]] == [
        ("ball", "mass"), ("mark", "landmark"), ("nipple", "nipple"),
    ]  # fmt: skip
    assert [row["view"] for row in rows] == ["CC"] * 3 + ["MLO"] * 3
    ball = rows[0]
    # Voxels of 1 mm whose centres lie in a ball of 6 mm around the place asked for.
    assert [float(ball[f"{axis}_mm"]) for axis in "xyz"] == pytest.approx([12, 8, 6], abs=0.5)
    assert float(ball["shift_mm"]) == pytest.approx(
        np.linalg.norm([float(ball[f"shift_{axis}_mm"]) for axis in "xyz"]), abs=1e-3
    )


def test_the_record_tells_how_it_was_made(finished):
    record = json.loads((finished / "run.json").read_text())
    assert record["status"] == "done"
    assert record["seed"] == 3
    assert record["settings"]["compression"]["thickness_mm"] == 36
    assert record["stage_seconds"]["LCC.compression"] > 0
    for name, digest in record["files"].items():
        assert hashlib.sha256((finished / name).read_bytes()).hexdigest() == digest


def test_the_same_run_gives_the_same_bytes_again(folder, finished):
    again = folder / "again"
    assert invoke("run", folder / "run.yaml", "--output", again).exit_code == 0
    for path in sorted(finished.rglob("*")):
        if path.is_file() and path.name not in ("run.json", "report.html"):
            other = again / path.relative_to(finished)
            assert other.read_bytes() == path.read_bytes(), path


def test_the_saved_configuration_runs_again(folder, finished):
    other = folder / "third"
    assert invoke("run", finished / "config.yaml", "--output", other).exit_code == 0
    assert (other / "lesions.csv").read_bytes() == (finished / "lesions.csv").read_bytes()


def test_the_python_api_gives_what_the_command_line_wrote(folder, finished):
    study = simulate(load_config(folder / "run.yaml"))
    assert set(study.views) == {"LCC", "LMLO"}
    rows = list(csv.DictReader((finished / "lesions.csv").open()))
    shifts = [target.shift_mm for target in study.targets]
    np.testing.assert_allclose(shifts, [float(row["shift_mm"]) for row in rows], atol=1e-4)


def test_a_full_folder_needs_a_word(folder, finished):
    result = invoke("run", folder / "run.yaml", "--output", finished)
    assert result.exit_code == 2
    assert "give --resume, --overwrite" in result.output
    result = invoke("run", folder / "run.yaml", "--output", finished, "--resume")
    assert result.exit_code == 0
    assert "already finished" in result.output


def test_a_view_may_have_its_own_values(folder):
    path = write(folder, "views.yaml", views=["CC", {"view": "MLO", "thickness_mm": 40}])
    config = load_config(path)
    thickness = [view.compression.thickness_mm for view in config.resolved_views]
    assert thickness == [36, 40]


def test_set_changes_a_key(folder):
    path = write(folder, "set.yaml")
    config = load_config(path, ["compression.thickness_mm=41.5", "views=[CC]"])
    assert config.compression.thickness_mm == 41.5
    assert [view.view for view in config.views] == ["CC"]


def test_check_prints_the_plan_and_computes_nothing(folder):
    result = invoke("check", write(folder, "check.yaml"))
    assert result.exit_code == 0
    assert "breast.npz" in result.output
    assert "CC: compressed to 36 mm (springs, multigrid" in result.output
    assert "GB of memory" in result.output
    assert not (folder / "runs").exists()


def test_info_describes_a_phantom(folder):
    result = invoke("info", folder / "breast.npz")
    assert result.exit_code == 0
    for word in ("voxel", "adipose", "gland", "mL"):
        assert word in result.output


def test_new_writes_an_example_that_is_valid(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "quickstart").exit_code == 0
    assert invoke("check", "quickstart.yaml").exit_code == 0
    again = invoke("new", "quickstart")
    assert again.exit_code == 2
    assert "exists already" in again.output
    unknown = invoke("new", "quickstar")
    assert unknown.exit_code == 2
    assert "expected one of" in unknown.output


def test_the_help_of_new_lists_every_example():
    said = " ".join(invoke("new", "--help").output.split())
    folder = Path(__file__).parents[1] / "configs"
    for path in folder.glob("*.yaml"):
        assert f"{path.stem}: " in said
    assert "quickstart: A generated breast in two views" in said


def test_the_version_is_printed():
    result = invoke("--version")
    assert (result.exit_code, result.output.strip()) == (0, mammosim.__version__)


@pytest.mark.parametrize(
    ("words", "offered"), [("mammosim ru", "run"), ("mammosim new qu", "quickstart")]
)
def test_the_shell_completes_commands_and_examples(words, offered):
    asked = {
        "_MAMMOSIM_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-m", "mammosim"], env={**os.environ, **asked}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == [offered]


BAD = [
    ({"phantom": {"file": "nowhere.mhd"}}, r"nowhere.mhd: no such file"),
    ({"phantom": {}}, r"phantom"),
    ({"compresion": {}}, r"compresion: unknown key; did you mean 'compression'"),
    ({"compression": {"thickness_mm": "thin"}}, r"compression.thickness_mm: found 'thin'"),
    ({"compression": {"thickness_mm": 500}}, r"thickness_mm: found 500, but the breast"),
    ({"views": []}, r"views: found \[\], expected at least 1 of them"),
    ({"views": ["CC", "CC"]}, r"CC is listed twice"),
    ({"views": ["XCC"]}, r"views.0.view: found 'XCC', expected 'CC', 'MLO' or 'ML'"),
    (
        {"views": [{"view": "CC", "thicknes_mm": 3}]},
        r"views.0.thicknes_mm: unknown key",
    ),
    (
        {"views": [{"view": "CC", "compression": {"thickness_mm": -3}}]},
        r"views.0.compression.thickness_mm: found -3",
    ),
    ({"acquisition": {"kvp": 90}}, r"kvp: found 90"),
    ({"projection": {"pixel_mm": 0}}, r"projection.pixel_mm: found 0"),
    ({"projection": {"detector_mm": [0, 20]}}, r"detector"),
    ({"laterality": "left"}, r"laterality: found 'left', expected L, R, or both as \[R, L\]"),
    ({"seed": -1}, r"seed: found -1"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_input_exits_2_with_plain_lines(changes, message, folder, tmp_path):
    path = write(folder, "bad.yaml", **changes)
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert __import__("re").search(message, result.output), result.output
    written = [item.name for item in tmp_path.rglob("*") if item.is_file()]
    assert not any(name.startswith(".part") for name in written)
    assert "run.json" not in written


def test_a_lesion_outside_the_breast_is_named(folder, tmp_path):
    phantom = {
        "file": "breast.npz",
        "lesions": [{"name": "lost", "kind": "mass", "diameter_mm": 6, "position_mm": [90, 0, 0]}],
    }
    path = write(folder, "lost.yaml", phantom=phantom)
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 2
    assert "lost" in result.output


def test_every_mistake_is_listed(folder, tmp_path):
    path = write(folder, "many.yaml", seed=-1, laterality="X", compression={"resolution_mm": 0})
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 2
    assert result.output.count("error:") == 3


def test_a_missing_configuration():
    result = invoke("run", "nowhere.yaml")
    assert result.exit_code == 2
    assert "nowhere.yaml: no such file" in result.output


def test_a_read_only_output_is_said_plainly(folder, tmp_path, monkeypatch):
    blocked = tmp_path / "blocked"
    blocked.write_text("a file, not a folder")
    result = invoke("run", write(folder), "--output", blocked / "out")
    assert result.exit_code == 2
    assert "cannot be written" in result.output
    if os.geteuid() != 0:
        read_only = tmp_path / "read_only"
        read_only.mkdir(mode=0o500)
        result = invoke("run", write(folder), "--output", read_only / "out")
        assert result.exit_code == 2


def test_what_did_not_converge_is_saved_and_marked(folder, tmp_path):
    compression = {**SMALL["compression"], "solver": "relaxation", "max_sweeps": 4}
    path = write(folder, "short.yaml", compression=compression, views=["CC"])
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 3
    assert "relaxation stopped" in result.output
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "not converged"
    assert any("did not converge" in warning for warning in record["warnings"])
    reached = json.loads((tmp_path / "out" / "LCC" / "compression.json").read_text())
    assert reached["converged"] is False
    assert "did not converge" in (tmp_path / "out" / "report.html").read_text()
    assert len((tmp_path / "out" / "LCC" / "convergence.csv").read_text().splitlines()) == 5


def test_an_interrupted_run_keeps_what_it_reached(folder, tmp_path, monkeypatch):
    from mammosim.compression.springs import relaxation

    original = relaxation.sweep
    visits = []

    def stopped(*arguments):
        visits.append(1)
        if len(visits) == 3:
            raise KeyboardInterrupt
        original(*arguments)

    monkeypatch.setattr(relaxation, "sweep", stopped)
    compression = {**SMALL["compression"], "solver": "relaxation"}
    path = write(folder, "stop.yaml", compression=compression, views=["CC"])
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 130
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "interrupted"
    assert (tmp_path / "out" / "LCC" / "displacement.nii.gz").exists()


def test_debug_shows_the_traceback(folder):
    result = invoke("--debug", "run", "nowhere.yaml")
    assert isinstance(result.exception, InputError)

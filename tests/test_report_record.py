"""The record of a run: identity, file hashes, references."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from importlib.metadata import version

import numpy
import pytest

from mammosim.report import REFERENCES, file_hash, references_used, run_hash, run_record

SETTINGS = {"phantom": {"file": "p.mhd", "labels": "victre"}, "compression": {"thickness_mm": 50.0}}


def test_the_hash_of_a_run_depends_on_all_that_decides_it_and_on_nothing_else():
    base = run_hash(SETTINGS, 1, "0.1", ["aa"])
    assert re.fullmatch("[0-9a-f]{64}", base)
    assert base == run_hash(dict(reversed(SETTINGS.items())), 1, "0.1", ["aa"])
    others = [
        run_hash(SETTINGS | {"export": {}}, 1, "0.1", ["aa"]),
        run_hash(SETTINGS, 2, "0.1", ["aa"]),
        run_hash(SETTINGS, 1, "0.2", ["aa"]),
        run_hash(SETTINGS, 1, "0.1", ["bb"]),
    ]
    assert len({base, *others}) == 5


def test_the_hash_is_the_same_on_every_day_and_machine():
    # Taken once; a change here changes the UIDs of every run and belongs in the change log.
    expected = hashlib.sha256(
        b'{"inputs":[],"seed":1,"settings":{"a":0.5},"version":"0.1"}'
    ).hexdigest()
    assert run_hash({"a": 0.5}, 1, "0.1") == expected


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "LCC").mkdir()
    (tmp_path / "LCC" / "image.dcm").write_bytes(b"pixels" * 400_000)  # more than one block
    (tmp_path / "lesions.csv").write_text("a,b\n")
    (tmp_path / "run.json").write_text("old")
    (tmp_path / "report.html").write_text("old")
    (tmp_path / "LCC" / ".part-image.dcm").write_text("left by a crash")
    return tmp_path


def record(folder, **changes):
    arguments = {
        "status": "done", "seed": 7, "settings": SETTINGS, "stage_seconds": {"compress": 1.23456},
    }  # fmt: skip
    return run_record(folder, **(arguments | changes))


def test_every_file_of_the_run_is_hashed_and_no_other(folder):
    files = record(folder)["files"]
    assert list(files) == ["LCC/image.dcm", "lesions.csv"]
    assert files["LCC/image.dcm"] == hashlib.sha256(b"pixels" * 400_000).hexdigest()
    assert files["lesions.csv"] == file_hash(folder / "lesions.csv")


def test_the_record_holds_what_was_promised(folder):
    made = record(folder, warnings=["one", "two", "one"], run_hash="ab")
    assert json.loads(json.dumps(made)) == made  # plain values only
    assert (made["status"], made["seed"], made["run_hash"]) == ("done", 7, "ab")
    assert made["settings"] == SETTINGS
    assert made["stage_seconds"] == {"compress": 1.235}
    assert made["warnings"] == ["one", "two"]
    assert made["versions"]["numpy"] == numpy.__version__
    assert made["versions"]["mammosim"] == version("mammosim")
    assert "itk-rtk" in made["versions"]  # of the extra for slices; the others are always there
    missing = [name for name, found in made["versions"].items() if found == "not installed"]
    assert set(missing) <= {"itk-rtk"}


def test_peak_memory_is_in_megabytes(folder):
    """An array of 300 MB that is touched raises the peak of this process to at least that."""
    touched = numpy.ones(300_000_000, numpy.uint8)
    peak = record(folder)["peak_memory_mb"]
    del touched
    assert 300 <= peak < 100_000


@pytest.mark.skipif(sys.platform != "linux", reason="told by Linux only")
def test_the_peak_is_not_that_of_the_program_which_started_this_one(tmp_path):
    """A worker of a cohort that a large session starts is not as large as the session was."""
    touched = numpy.ones(1_500_000_000, numpy.uint8)
    words = (
        "from mammosim.report import run_record;"
        f"made = run_record({str(tmp_path)!r}, status='done', seed=1, settings={{}},"
        " stage_seconds={});"
        "print(made['peak_memory_mb'])"
    )
    told = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, check=True
    ).stdout
    del touched
    assert 20 <= float(told) < 1_000


def test_a_package_that_is_missing_is_said_to_be_so(folder, monkeypatch):
    monkeypatch.setattr("mammosim.report.record.PACKAGES", ("no-such-package",))
    assert record(folder)["versions"]["no-such-package"] == "not installed"


def keys(settings) -> set[str]:
    used = references_used(settings)
    return {key for key, reference in REFERENCES.items() if reference in used}


def test_only_what_was_used_is_cited():
    springs = keys({"compression": {"model": "springs"}})
    assert {"springs", "wellman", "spekpy", "boone", "dance1990"} <= springs
    assert {"springs", "wellman"} & keys({}) == set()
    assert "aspiration" in keys({})
    assert "victre" not in keys({})
    assert "victre" in keys(SETTINGS)
    fem = keys({"compression": {"model": "hyperelastic", "stiffness": "victre"}})
    assert "springs" not in fem
    assert "wellman" not in fem
    assert "victre" in fem
    assert "krouskop" not in fem
    assert "krouskop" in keys({"compression": {"stiffness": "krouskop"}})
    assert "spekpy" not in keys({"acquisition": {"spectrum_file": "tube.csv"}})
    assert "simpleitk" not in keys({"export": {"volumes": False}})
    assert "samani" not in keys({"targets": {}})
    assert {"samani", "krouskop", "hauge"} <= keys({"targets": {"uncertainty": {"samples": 50}}})
    assert {"rtk", "dance2011"} & keys({"views": ["CC", {"view": "MLO"}]}) == set()
    series = {"view": "CC", "projections": 9}
    assert {"rtk", "dance2011"} & keys({"views": [{"dbt": series}]}) == {"dance2011"}
    assert {"rtk", "dance2011"} <= keys({"views": [{"dbt": {**series, "reconstruct": {}}}]})
    assert "plotly" in keys({})
    assert "plotly" not in keys({"report": {"three_d": False}})


def test_every_doi_has_the_form_of_one():
    dois = [reference.doi for reference in REFERENCES.values() if reference.doi]
    assert len(set(dois)) == len(dois) >= 12
    for doi in dois:
        assert re.fullmatch(r"10\.\d{4,9}/\S+", doi), doi

"""Stages are computed again exactly where something they depend on has changed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import tifffile
from make_records import make_compressed, make_phantom
from make_run import SMALL, invoke, save_breast, write

from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.pipeline import RunFolder, is_being_written, load_config, simulate, writing
from mammosim.pipeline.folder.serialization import pack, unpack
from mammosim.pipeline.folder.stage_cache import COMPRESSION_ROOMS, PHANTOM_ROOMS, stage_key

GENERATED = {"generate": {"voxel_mm": 3.0, "volume_ml": 200, "density": "fatty"}}


def data_of(folder: Path) -> dict[str, bytes]:
    """Every file of a run that a rerun must repeat byte by byte."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and path.name not in ("run.json", "report.html")
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    }


def record(folder: Path) -> dict:
    return json.loads((folder / "run.json").read_text())


@pytest.fixture(scope="module")
def user(tmp_path_factory) -> Path:
    """A folder with a phantom and two small configurations."""
    folder = save_breast(tmp_path_factory.mktemp("user"))
    write(folder)
    write(folder, "generated.yaml", phantom=GENERATED, views=["CC"])
    return folder


@pytest.fixture(scope="module")
def first(user) -> Path:
    """A finished run of the generated breast."""
    output = user / "first"
    assert invoke("run", user / "generated.yaml", "--output", output).exit_code == 0
    return output


def again(user, first, *arguments, output=None):
    """Another run that may take the first one's stages; gives what it reused and its data."""
    output = output or user / "again"
    result = invoke(
        "run", user / "generated.yaml", "--output", output, "--overwrite", "--reuse", first,
        *arguments,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    return record(output)["stages_reused"], data_of(output)


def test_a_folder_holds_what_is_made_without_one(user, first):
    """The generated breast is open to the axilla, which is left out of this view."""
    study = simulate(load_config(user / "generated.yaml"))
    assert study.breast.open_end is not None
    held = study.views["LCC"].compressed.phantom
    assert np.count_nonzero(held.labels) < np.count_nonzero(study.breast.labels)
    picture = tifffile.imread(first / "LCC" / "mammogram.tif")
    np.testing.assert_array_equal(picture, study.views["LCC"].mammogram.for_processing)
    resumed = simulate(load_config(user / "generated.yaml"), RunFolder(
        user / "kept", load_config(user / "generated.yaml"), "kept", [first]))  # fmt: skip
    np.testing.assert_array_equal(resumed.views["LCC"].compressed.phantom.labels, held.labels)


@pytest.mark.usefixtures("breasts_are_made_once")
@pytest.mark.parametrize(
    ("change", "reused"),
    [
        ("acquisition.kvp=31", ["phantom", "LCC.compression"]),
        ("projection.pixel_mm=0.9", ["phantom", "LCC.compression"]),
        ("compression.thickness_mm=37", ["phantom"]),
        ("laterality=R", []),
        ("seed=4", []),
    ],
)
def test_a_change_computes_again_what_depends_on_it_and_no_more(user, first, change, reused):
    found, data = again(user, first, "--set", change, output=user / "changed")
    assert found == reused
    afresh = user / "afresh"
    result = invoke(
        "run", user / "generated.yaml", "--set", change, "--overwrite", "--output", afresh
    )
    assert result.exit_code == 0, result.output
    assert data == data_of(afresh)
    for path in afresh.glob(".stages/*"):
        path.unlink()


def test_a_phantom_file_with_other_voxels_is_compressed_again(user, tmp_path):
    folder = save_breast(tmp_path)
    path = write(folder, views=["CC"])
    output = tmp_path / "out"
    assert invoke("run", path, "--output", output).exit_code == 0
    assert invoke("run", path, "--output", output, "--overwrite").exit_code == 0
    assert record(output)["stages_reused"] == ["LCC.compression"]
    content = dict(np.load(folder / "breast.npz"))
    content["labels"][10:14, 28:32, 26:30] = 1
    np.savez(folder / "breast.npz", **content)
    assert invoke("run", path, "--output", output, "--overwrite").exit_code == 0
    assert record(output)["stages_reused"] == []


def test_the_key_depends_on_code_settings_and_inputs(monkeypatch):
    base = stage_key(PHANTOM_ROOMS, {"a": 1}, ["aa"])
    others = {
        stage_key(COMPRESSION_ROOMS, {"a": 1}, ["aa"]),
        stage_key(PHANTOM_ROOMS, {"a": 2}, ["aa"]),
        stage_key(PHANTOM_ROOMS, {"a": 1}, ["ab"]),
    }
    monkeypatch.setattr(
        "mammosim.pipeline.folder.stage_cache._code_hash", lambda rooms: "other code"
    )
    others.add(stage_key(PHANTOM_ROOMS, {"a": 1}, ["aa"]))
    assert len(others | {base}) == 5


@pytest.mark.parametrize("damage", ["cut", "flip", "note", "gone", "nested"])
def test_a_damaged_stage_is_computed_again(user, first, damage, tmp_path):
    reference = data_of(first)
    file = first / ".stages" / "LCC.compression.npz"
    note = file.with_suffix(".json")
    sound, sound_note = file.read_bytes(), note.read_text()
    if damage == "cut":
        file.write_bytes(sound[: len(sound) // 2])
    elif damage == "flip":
        file.write_bytes(sound[:-1000] + bytes([sound[-1000] ^ 1]) + sound[-999:])
    elif damage == "note":
        note.write_text("[]")
    elif damage == "nested":
        note.write_text("[" * 100_000)
    else:
        file.unlink()
    found, data = again(user, first, output=tmp_path / "out")
    assert found == ["phantom"]
    assert data == reference
    file.write_bytes(sound)
    note.write_text(sound_note)


def test_a_run_that_was_killed_goes_on_where_it_was(user, tmp_path):
    """Killed in MLO's compression: CC is not compressed again and the bytes are the same."""
    path, output, whole = write(user, "both.yaml"), tmp_path / "out", tmp_path / "whole"
    assert invoke("run", path, "--output", whole).exit_code == 0
    assert invoke("run", path, "--output", output, "--set", "views=[CC]").exit_code == 0
    (output / "run.json").unlink()
    (output / "LCC" / ".part-mammogram.tif").write_bytes(b"half a picture")
    (output / ".stages" / ".part-LMLO.compression.npz").write_bytes(b"half a field")
    result = invoke("run", path, "--output", output, "--resume")
    assert result.exit_code == 0, result.output
    assert not list(output.rglob(".part-*"))
    assert record(output)["stages_reused"] == ["LCC.compression"]
    assert data_of(output) == data_of(whole)


def test_a_finished_run_with_a_changed_file_is_run_again(user, tmp_path):
    path, output = write(user, "one.yaml", views=["CC"]), tmp_path / "out"
    assert invoke("run", path, "--output", output).exit_code == 0
    before = data_of(output)
    assert "already finished" in invoke("run", path, "--output", output, "--resume").output
    picture = output / "LCC" / "mammogram.tif"
    picture.write_bytes(picture.read_bytes()[:-1])
    result = invoke("run", path, "--output", output, "--resume")
    assert "already finished" not in result.output
    assert data_of(output) == before


def test_overwriting_leaves_nothing_of_the_earlier_run_but_what_the_user_put_there(user, tmp_path):
    output = tmp_path / "out"
    path = write(user, "two.yaml", views=["CC", "MLO"])
    assert invoke("run", path, "--output", output).exit_code == 0
    (output / "notes.txt").write_text("mine")
    (output / "LMLO" / "preview.png").write_text("retouched by hand")
    result = invoke("run", path, "--output", output, "--overwrite", "--set", "views=[CC]")
    assert result.exit_code == 0, result.output
    assert (output / "notes.txt").read_text() == "mine"
    assert [item.name for item in (output / "LMLO").iterdir()] == ["preview.png"]


def test_a_record_cannot_name_files_outside_its_folder(user, tmp_path):
    import hashlib

    victim = tmp_path / "precious.txt"
    victim.write_text("precious")
    output = tmp_path / "out"
    output.mkdir()
    hashes = {"../precious.txt": hashlib.sha256(b"precious").hexdigest(), "": None, "\0": "x"}
    (output / "run.json").write_text(
        json.dumps({"status": "done", "run_hash": "0", "files": hashes})
    )
    path = write(user, "path.yaml", views=["CC"])
    assert invoke("run", path, "--output", output, "--overwrite").exit_code == 0
    assert victim.read_text() == "precious"


def test_the_record_alone_runs_again_to_the_same_bytes(user, first, tmp_path):
    elsewhere = tmp_path / "run.json"
    elsewhere.write_bytes((first / "run.json").read_bytes())
    result = invoke("run", elsewhere, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert data_of(tmp_path / "out") == data_of(first)


def test_two_runs_on_one_folder(user, tmp_path):
    output = tmp_path / "out"
    with writing(output):
        assert is_being_written(output)
        result = invoke("run", user / "generated.yaml", "--output", output, "--overwrite")
        assert result.exit_code == 2
        assert f"in use by another run (process {os.getpid()}" in result.output
    assert not is_being_written(output)
    assert not output.exists()  # nothing was written: nothing is left


def test_a_folder_that_cannot_be_made_is_said_plainly(tmp_path):
    (tmp_path / "file").write_text("a file")
    with pytest.raises(InputError, match=r"out: cannot be written \(Not a directory\)"):
        writing(tmp_path / "file" / "out").__enter__()


def test_what_is_kept_comes_back_bit_by_bit():
    compressed = make_compressed(View("MLO", "R"), notes=("½ a note",))
    arrays: dict = {}
    text = json.dumps(pack(compressed, arrays))
    back = unpack(json.loads(text), arrays)
    again: dict = {}
    assert json.dumps(pack(back, again)) == text
    assert arrays.keys() == again.keys()
    for name in arrays:
        assert arrays[name].dtype == again[name].dtype
        assert arrays[name].tobytes() == again[name].tobytes()
    assert dict(back.measures) == dict(compressed.measures)
    assert back.phantom.lesions[0].name == make_phantom().lesions[0].name


def test_what_cannot_be_kept_is_refused():
    with pytest.raises(TypeError, match="holds a set, which cannot be kept"):
        pack({1, 2}, {})


def test_settings_of_a_record_equal_the_configurations(user, first):
    config = load_config(user / "generated.yaml")
    assert load_config(first / "run.json").plain() == config.plain()
    assert record(first)["views"]["LCC"]["dose_mgy"] > 0.1
    assert SMALL["compression"]["thickness_mm"] == record(first)["views"]["LCC"]["thickness_mm"]

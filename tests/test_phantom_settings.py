"""Keys of a configuration about a phantom's file."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import numpy as np
import pytest
from make_volumes import save_series, save_victre, small_breast
from typer.testing import CliRunner

from mammosim import cli
from mammosim.config import to_settings, write_yaml
from mammosim.errors import InputError
from mammosim.phantom import PhantomSettings, make_phantom
from mammosim.phantom.size import expected_voxels
from mammosim.pipeline import RunConfig, RunFolder, load_config


@pytest.mark.parametrize(
    ("values", "message"),
    [({"file": "b.npy", "axes": "XYZ"},
      "phantom.axes: found 'XYZ', expected three letters such as ALS"),
     ({"file": "b.npy", "voxel_mm": 0}, "voxel_mm: found 0, expected lengths of 0.001 to 10 mm"),
     ({"file": "b.npy", "voxel_mm": [1, 2]}, "phantom.voxel_mm"),
     ({"file": "b.npy", "voxel_mm": [1, 2, 30]}, r"voxel_mm: found \[1, 2, 30\], expected lengths"),
     ({"file": "b.npy", "reduce": 0}, "phantom.reduce: found 0, expected greater than or equal to"),
     ({"file": "b.npy", "reduce": 1.5}, "phantom.reduce: found 1.5"),
     ({"generate": {}, "axes": "ALS"}, "'axes' belongs to 'file', not to 'generate'"),
     ({"generate": {}, "reduce": 2}, "'reduce' belongs to 'file', not to 'generate'"),
     ({"generate": {}, "labels": "victre"}, "'labels' belongs to 'file', not to 'generate'")],
)  # fmt: skip
def test_keys_that_cannot_be(values, message):
    with pytest.raises(InputError, match=message):
        to_settings(RunConfig, {"phantom": values}, "file.yaml")


def test_a_generated_breast_as_saved_is_valid_again():
    config = to_settings(RunConfig, {"phantom": {"generate": {"voxel_mm": 0.5}}}, "file.yaml")
    assert to_settings(RunConfig, config.plain(), "again.yaml") == config


def test_the_keys_reach_the_reader(tmp_path):
    np.save(tmp_path / "b.npy", small_breast().transpose(2, 0, 1))
    settings = PhantomSettings(
        file="b.npy", axes="SAL", voxel_mm=(1.0, 0.5, 0.75), reduce=2, labels="victre"
    )
    breast = make_phantom(settings, folder=tmp_path)
    np.testing.assert_array_equal(breast.labels, small_breast()[1::2, 1::2, 1::2])
    np.testing.assert_allclose(breast.voxel_mm, [1.0, 1.5, 2.0])


def test_the_size_is_known_before_anything_is_read(tmp_path):
    np.save(tmp_path / "b.npy", small_breast())
    file = str(tmp_path / "b.npy")
    assert expected_voxels(PhantomSettings(file=file)) == (7 * 9 * 11, 1.0)
    reduced = PhantomSettings(file=file, reduce=2, voxel_mm=0.5)
    assert expected_voxels(reduced) == (7 * 9 * 11 // 8, 1.0)
    save_series(tmp_path / "series", small_breast())
    assert expected_voxels(PhantomSettings(file=str(tmp_path / "series"))) == (693, 0.375)


def check(folder: Path, **phantom):
    write_yaml({"phantom": phantom}, folder / "c.yaml")
    return CliRunner().invoke(cli.app, ["check", str(folder / "c.yaml")])


def test_check_takes_a_folder_and_refuses_what_cannot_be(tmp_path):
    save_series(tmp_path / "series", small_breast())
    result = check(tmp_path, file="series", labels="victre")
    # The folder is read; its breast of a few voxels is too small for plates, and nothing else.
    assert result.exit_code == 2
    assert re.fullmatch(r"error: compression.plate_edge_mm: .*must be smaller\n", result.output)
    for phantom, message in (
        ({"labels": "nowhere"}, "phantom.labels: found 'nowhere'"),
        ({"labels": "no.yaml"}, "no.yaml: no such file"),
        ({"reduce": 9}, "phantom.reduce: found 9, expected 1 to 7"),
        ({"file": "nothing"}, "unknown format"),
    ):
        result = check(tmp_path, **{"file": "series", **phantom})
        assert result.exit_code == 2
        assert re.search(message, result.output)


def test_a_runs_hash_depends_on_every_file_of_the_phantom(tmp_path):
    """Voxels lie beside an MHD's header: other voxels are another run."""
    write_yaml({"phantom": {"file": "b.mhd"}}, tmp_path / "c.yaml")
    hashes = set()
    for label in (1, 29):
        labels = small_breast()
        labels[3, 4, 5] = label
        save_victre(tmp_path, gzip.compress(labels.tobytes(order="F"), mtime=0))
        folder = RunFolder(tmp_path / f"run{label}", load_config(tmp_path / "c.yaml"))
        hashes.add(folder._hash)
    assert len(hashes) == 2

"""The MATLAB file: places, tissue, parameters and convergence of the compressed lattice."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from make_records import HISTORY, make_compressed
from scipy.io import loadmat

import mammosim
from mammosim.errors import InputError
from mammosim.export import ExportSettings, write_compressed, write_matlab
from mammosim.geometry import View


@pytest.mark.parametrize("view", [View("CC", "L"), View("MLO", "R")])
def test_places_and_tissue_come_back(tmp_path, view):
    compressed = make_compressed(view)
    write_matlab(compressed, tmp_path / "springs.mat")
    saved = loadmat(tmp_path / "springs.mat")
    field = compressed.field
    nodes = np.stack(np.indices(field.frame.shape), axis=-1)
    expected = field.frame.position_mm(nodes) + field.displacement_mm
    for axis, name in enumerate("xyz"):
        # single precision of places up to 100 mm
        np.testing.assert_allclose(saved[name], expected[..., axis], atol=1e-5)
        np.testing.assert_allclose(
            saved[f"{name}0"][:, 0], np.unique(field.frame.position_mm(nodes)[..., axis])
        )
    np.testing.assert_array_equal(saved["tissue"] == 1, field.tissue)
    assert (saved["label"][~field.tissue] == 0).all()


def test_the_label_of_a_node_is_the_phantoms_in_every_view(tmp_path):
    for view in (View("CC", "L"), View("MLO", "L"), View("MLO", "R")):
        compressed = make_compressed(view)
        write_matlab(compressed, tmp_path / "springs.mat")
        saved = loadmat(tmp_path / "springs.mat", simplify_cells=True)
        lesion = compressed.phantom.lesions[0]
        place = compressed.field.frame.index(view.rotation @ lesion.position_mm)
        assert saved["label"][tuple(np.rint(place).astype(int))] == lesion.label
        assert saved["tissue_of_label"][f"label_{lesion.label}"] == "mass"


def test_parameters_and_convergence(tmp_path):
    compressed = make_compressed(View("CC", "L"))
    write_matlab(compressed, tmp_path / "springs.mat")
    saved = loadmat(tmp_path / "springs.mat", simplify_cells=True)
    assert saved["parameters"]["view"] == "CC"
    assert saved["parameters"]["thickness_mm"] == 52.0
    assert saved["parameters"]["force_n"] == 91.3
    assert saved["parameters"]["converged"] == 1
    assert set(saved["convergence"]) == set(HISTORY.dtype.names)
    np.testing.assert_array_equal(saved["convergence"]["residual"], HISTORY["residual"])


def test_a_history_with_letters_and_one_without_rows(tmp_path):
    compressed = make_compressed(View("CC", "L"))
    letters = np.array([(1, "z"), (2, "x")], [("iteration", "i4"), ("axis", "U1")])
    write_matlab(dataclasses.replace(compressed, history=letters), tmp_path / "a.mat")
    saved = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert list(saved["convergence"]["axis"]) == ["z", "x"]
    write_matlab(dataclasses.replace(compressed, history=letters[:0]), tmp_path / "b.mat")
    assert np.size(loadmat(tmp_path / "b.mat", simplify_cells=True)["convergence"]["axis"]) == 0


@pytest.mark.parametrize("model", ["springs", "none"])
def test_a_real_compression(tmp_path, model):
    phantom = make_compressed(View("CC", "L")).phantom
    chosen = {"thickness_mm": 55.0, "resolution_mm": 4.0} if model == "springs" else {}
    compressed = mammosim.compress(phantom, "CC", model=model, **chosen)
    write_matlab(compressed, tmp_path / "springs.mat")
    saved = loadmat(tmp_path / "springs.mat", simplify_cells=True)
    z = saved["z"][saved["tissue"] == 1]
    # All nodes beyond the plates' edge stay between them, to single precision.
    beyond = saved["x"][saved["tissue"] == 1] > compressed.plate_edge_mm
    assert z[beyond].max() <= compressed.paddle_z_mm + 1e-4
    assert z[beyond].min() >= compressed.support_z_mm - 1e-4
    if model == "springs":  # air has no stiffness, tissue has some everywhere
        np.testing.assert_array_equal(saved["modulus_kpa"] > 0, saved["tissue"] == 1)
        np.testing.assert_array_equal(saved["modulus_kpa"], compressed.modulus_kpa)
    else:
        assert "modulus_kpa" not in saved
    tissue = {"springs": saved["label"][saved["tissue"] == 1] > 0, "none": np.array([True])}
    assert tissue[model].mean() > 0.9  # a surface node's own voxel may be air


def test_reruns_are_identical_whatever_the_time(tmp_path, monkeypatch):
    compressed = make_compressed(View("CC", "L"))
    write_matlab(compressed, tmp_path / "a.mat")
    monkeypatch.setattr(time, "asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    write_matlab(compressed, tmp_path / "b.mat")
    content = (tmp_path / "a.mat").read_bytes()
    assert content == (tmp_path / "b.mat").read_bytes()
    # MAT-file level 5: 116 bytes of text, 8 of offset, version 0x0100, and the byte order.
    assert content[:19] == b"MATLAB 5.0 MAT-file"
    assert content[124:128] == b"\x00\x01IM"


def test_only_on_request(tmp_path):
    compressed = make_compressed(View("CC", "L"))
    write_compressed(tmp_path / "a", compressed, ExportSettings(volumes=False))
    assert not (tmp_path / "a" / "springs.mat").exists()
    write_compressed(tmp_path / "b", compressed, ExportSettings(volumes=False, matlab=True))
    assert (tmp_path / "b" / "springs.mat").is_file()


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "LCC").write_text("a file")
    with pytest.raises(InputError, match=r"springs\.mat: cannot be written"):
        write_matlab(make_compressed(View("CC", "L")), tmp_path / "LCC" / "springs.mat")

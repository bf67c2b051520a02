"""`mammosim check` says what `mammosim run` will refuse, before anything is compressed."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from make_run import SMALL, invoke, save_breast, write

from mammosim.compression import compress
from mammosim.phantom import LesionSettings, insert_lesions, read_phantom
from mammosim.pipeline import config_of, make_plan, return_freed_memory
from mammosim.projection import project

GENERATED = {"density": "fatty", "voxel_mm": 2.0, "volume_ml": 300}


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"phantom": {"file": "breast.npz", "lesions": [
        {"name": f"c{number}", "kind": "clip"} for number in range(500)]}},
      "phantom.lesions: found 500 entries, expected at most 101"),
     ({"compression": {"thickness_mm": 90}}, "thickness_mm: found 90, but the breast between"),
     ({"compression": {"plate_edge_mm": 60}}, "plate_edge_mm: found 60, but tissue extends only"),
     ({"views": ["CC", {"view": "MLO", "thickness_mm": 80}]}, "thickness_mm: found 80"),
     ({"phantom": {"file": "breast.npz", "lesions": [
         {"name": "m", "kind": "mass", "position_mm": [29, 29, 29]}]}}, "phantom.lesions.0"),
     ({"phantom": {"file": "breast.npz", "lesions": [
         {"name": "m", "kind": "mass", "position_mm": [12, 0, 0]},
         {"name": "n", "kind": "mass", "position_mm": [13, 0, 0]}]}}, "overlaps"),
     ({"phantom": {"file": "breast.npz", "landmarks": [
         {"name": "p", "position_mm": [99, 0, 0]}]}}, "phantom.landmarks.0"),
     ({"projection": {"source_to_detector_mm": 50}}, "the focal spot must be above the breast"),
     ({"projection": {"detector_edge_mm": 200}}, "which has no tissue in front of it"),
     ({"projection": {"focal_spot_y_mm": 5000}}, "projection.focal_spot_y_mm: found 5000"),
     ({"acquisition": {"scatter": False, "grid_scatter_transmission": None}},
      "acquisition.grid_scatter_transmission: found null"),
     ({"acquisition": {"filter_mm": 5}}, "acquisition.filter_mm: the beam has"),
     ({"compression": {"model": "none", "thickness_mm": 40}}, "'none' does not compress")],
)  # fmt: skip
def test_what_run_refuses_is_refused_by_check(changes, message, tmp_path):
    path = write(save_breast(tmp_path), **changes)
    checked = invoke("check", path)
    assert checked.exit_code == 2, checked.output
    assert message in checked.output
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 2, result.output


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"acquisition": {"mas": 0.5}}, "CC: tube load: found 0.5 mAs, plausible from 1 mAs"),
        ({"acquisition": {"mas": 1000}}, "CC: tube load: found 1000 mAs, plausible up to 600 mAs"),
        ({"compression": {"thickness_mm": 5}}, "CC: compressed thickness: found 5 mm"),
        (
            {"compression": {"model": "springs", "spring_law": "exponential"}},
            "compression.spring_law: exponential",
        ),
        (
            {"compression": {"model": "hyperelastic", "stiffness_kpa": {"adipose": 0.001}}},
            "stiffness of gland relative to fat, or of fat to gland: found 3040, plausible up to",
        ),
        (
            {
                "phantom": {"file": "breast.npz", "voxel_mm": 5},
                "compression": {"model": "springs", "resolution_mm": 10},
            },
            "volume of the breast: found",
        ),
    ],
)
def test_what_the_settings_alone_make_doubtful_is_said_by_check(changes, said, tmp_path):
    result = invoke("check", write(save_breast(tmp_path), views=["CC"], **changes))
    assert result.exit_code == 0, result.output
    assert f"warning: {said}" in " ".join(result.output.split())


@pytest.mark.parametrize("mas", [1e308, 1e-9, 0])
def test_a_tube_load_that_cannot_be_computed_is_refused(mas, tmp_path):
    result = invoke("check", write(save_breast(tmp_path), acquisition={"mas": mas}))
    assert result.exit_code == 2
    assert "acquisition.mas" in result.output


def test_a_shadow_that_compression_makes_too_long_is_foreseen_as_cut_off(tmp_path):
    """The breast itself would fit: its shadow is estimated on a coarse lattice of springs."""
    projection = {"detector_mm": [60, 40], "pixel_mm": 0.8}
    path = write(save_breast(tmp_path), projection=projection, views=["CC"])
    result = invoke("check", path)
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "LCC: the breast is cut off at the detector's edge" in said
    assert "projection.detector_mm is 60 x 40" in said
    assert "by an estimate on a coarse lattice" in said
    run = invoke("run", path, "--output", tmp_path / "out")
    assert run.exit_code == 0, run.output
    assert "LCC: the breast is cut off at the detector's edge" in " ".join(run.output.split())


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"compression": {"thickness_mm": 150}}, "thickness_mm: found 150"),
     ({"compression": {"plate_edge_mm": 150}}, "plate_edge_mm: found 150"),
     ({"compression": {"model": "hyperelastic", "resolution_mm": 6,
                       "paddle": {"size_mm": [60, 60], "centre_mm": [40, 400]}}},
      "beside the breast, which extends from"),
     ({"phantom": {"generate": GENERATED, "lesions": [
         {"name": "m", "kind": "mass", "position_mm": [200, 0, 0]}]}}, "outside the breast"),
     ({"phantom": {"generate": GENERATED, "landmarks": [
         {"name": "m", "position_mm": [200, 0, 0]}]}}, "outside the breast")],
)  # fmt: skip
def test_a_generated_breast_is_checked_by_its_outline(changes, message, tmp_path):
    values = {"phantom": {"generate": GENERATED}, **SMALL, **changes}
    result = invoke("check", write(tmp_path, **values))
    assert result.exit_code == 2, result.output
    assert message in result.output


def check_of_mass(folder, place_mm, diameter_mm=6, views=("CC",), **sections):
    """Exit status and words of `check` for a generated breast with one mass."""
    mass = {"name": "m", "kind": "mass", "diameter_mm": diameter_mm, "position_mm": place_mm}
    phantom = {"generate": GENERATED, "lesions": [mass]}
    result = invoke("check", write(folder, phantom=phantom, views=list(views), **sections))
    return result.exit_code, " ".join(result.output.split())


def test_what_fits_passes(tmp_path):
    status, said = check_of_mass(tmp_path, [30, 0, 0])
    assert status == 0, said
    assert "'m'" not in said


@pytest.mark.parametrize(
    ("place", "diameter", "status", "message"),
    [
        ([30, 0, 110], 6, 2, "phantom.lesions.0: 'm' at [30.0, 0.0, 110.0] mm lies outside"),
        ([30, 0, 0], 90, 2, "extends beyond the breast with its 90 mm"),
        ([2, 0, 0], 6, 2, "extends beyond the breast with its 6 mm"),
        ([30, -27, 0], 6, 0, "reaches beyond the breast, or nearly so"),
    ],
)
def test_a_lesion_that_leaves_a_generated_breast_is_found_by_its_outline(
    place, diameter, status, message, tmp_path
):
    found, said = check_of_mass(tmp_path, place, diameter)
    assert found == status, said
    assert message in said


def test_a_lesion_that_the_image_will_not_show_is_foreseen(tmp_path):
    """Behind the plates and the detector, and in a breast from a file by its voxels."""
    part = "'m': part of the lesion in the image: found 0 %, plausible from 99 %"
    compression = {**SMALL["compression"], "plate_edge_mm": 15}
    status, said = check_of_mass(tmp_path, [6, 0, 0], compression=compression)
    assert status == 0, said
    assert f"LCC: mass {part}" in said
    mass = {"name": "m", "kind": "mass", "diameter_mm": 4, "position_mm": [4, 0, 0]}
    phantom = {"file": "breast.npz", "lesions": [mass]}
    path = write(save_breast(tmp_path), phantom=phantom, compression=compression, views=["CC"])
    assert f"LCC: mass {part}" in " ".join(invoke("check", path).output.split())
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert f"LCC: mass {part}" in " ".join(result.output.split())
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert any(part in warning for warning in record["warnings"])
    assert "part of the lesion in the image" in (tmp_path / "out" / "report.html").read_text()


def test_a_file_with_lesions_leaves_fewer(tmp_path):
    labels = np.ones((60, 60, 60), np.uint8)
    labels[4:56:12, 4:56:12, 4:56:12] = 200
    np.savez(tmp_path / "b.npz", labels=labels, voxel_mm=np.ones(3), origin_mm=np.zeros(3))
    lesions = [{"name": f"c{number}", "kind": "clip"} for number in range(10)]
    merged = {"merge_mm": 0, "min_volume_mm3": 0}
    phantom = {"file": "b.npz", "lesions": lesions, "lesions_from_labels": merged}
    result = invoke("check", write(tmp_path, phantom=phantom))
    assert result.exit_code == 2
    assert "separate lesions, at most 101" in result.output


def test_the_estimate_of_memory_counts_lesions():
    """A mask of each lesion at every pixel, in one view at a time."""

    def estimate_gb(count: int, **changes: object) -> float:
        lesions = [{"name": f"c{number}", "kind": "clip"} for number in range(count)]
        values = {"phantom": {"generate": GENERATED, "lesions": lesions}, **changes}
        return make_plan(config_of(values, Path(), "f.yaml")).memory_gb

    added = estimate_gb(100) - estimate_gb(0)
    assert added == pytest.approx(100 * 240 * 180 / 0.1**2 * 4.0 / 1e9)
    coarse = {"projection": {"pixel_mm": 1.0}}
    assert estimate_gb(100, **coarse) - estimate_gb(0, **coarse) < 0.02


def test_lesions_take_no_memory_where_no_ray_meets_them(tmp_path):
    """Path lengths of a clip are pages of zeros that are never written."""
    breast = read_phantom(save_breast(tmp_path) / "breast.npz", laterality="L")
    clip = LesionSettings(name="c", kind="clip", position_mm=(12.0, 0.0, 0.0))
    breast = insert_lesions(breast, [clip], np.random.default_rng(1))
    held = compress(breast, "CC", model="none")
    return_freed_memory()  # that a run in this process keeps, and would make the arrays of
    paths = project(held, pixel_mm=0.06)
    channel = list(paths.lesion_labels).index(151)
    for lengths in (paths.length_mm, paths.attenuating_mm):
        assert 0 < np.count_nonzero(lengths[channel]) < 0.01 * lengths[channel].size
        first = lengths.ctypes.data + lengths[0].nbytes * channel
        assert resident_part(first, lengths[channel].nbytes) < 0.6  # pages may be of 2 MB, of 48


def resident_part(address: int, size: int) -> float:
    """Part of a piece of memory whose pages this process has written (Linux: proc(5), pagemap)."""
    page = os.sysconf("SC_PAGE_SIZE")
    first, last = -(-address // page), (address + size) // page
    with open("/proc/self/pagemap", "rb") as table:
        table.seek(8 * first)
        entries = np.frombuffer(table.read(8 * (last - first)), np.uint64)
    exclusive = (entries >> np.uint64(56)) & np.uint64(1)  # the page of zeros is shared
    return float(exclusive.mean())


def test_a_breast_too_large_for_the_coarse_copy_is_refused_by_check(tmp_path, monkeypatch):
    monkeypatch.setattr("mammosim.projection.coarse_copy.MAX_VOXELS", 1000)
    path = write(save_breast(tmp_path), views=["CC"])
    result = invoke("check", path)
    assert result.exit_code == 2
    said = " ".join(result.output.split())
    assert "LCC: acquisition.scatter: the compressed breast needs" in said
    assert "at most 1e+03 are allowed; use model: kernels" in said
    kernels = write(
        save_breast(tmp_path), views=["CC"], acquisition={"scatter": {"model": "kernels"}}
    )
    assert invoke("check", kernels).exit_code == 0

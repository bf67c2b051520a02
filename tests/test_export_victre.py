"""The compressed breast for VICTRE's pipeline and MC-GPU."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from make_records import make_compressed

from mammosim.export import ExportSettings, write_compressed, write_victre
from mammosim.geometry import View
from mammosim.phantom.voxels import read_volume
from mammosim.projection import compressed_labels

VIEWS = [View("CC", "L"), View("MLO", "R")]
NEAR_MM = 2.0
"""The made-up phantom has voxels of 2 mm: a lesion's centre of voxels lies within one of them."""


@pytest.fixture(scope="module", params=VIEWS, ids=lambda view: view.folder)
def written(request, tmp_path_factory):
    compressed = make_compressed(request.param)
    labels, frame = compressed_labels(compressed)
    folder = tmp_path_factory.mktemp("victre")
    write_victre(compressed, labels, frame, folder, 7)
    return compressed, labels, frame, folder / "7"


def victre_crop(phantom: np.ndarray) -> tuple[slice, slice, slice]:
    """Where VICTRE's `crop` cuts [z, y, x], step by step: by the paddles in the last x layer."""
    nz, _, nx = phantom.shape
    bottom = next(z for z in range(nz) if (phantom[z, :, -1] == 50).any())
    top = next(z for z in range(nz - 1, 0, -1) if (phantom[z, :, -1] == 50).any())
    front = next(
        x for x in range(nx)
        if (phantom[top, :, x] == 50).any() or (phantom[bottom, :, x] == 50).any()
    )  # fmt: skip
    return slice(bottom, top), slice(None), slice(front, None)


def test_the_files_have_victres_names(written):
    names = {path.name for path in written[-1].iterdir()}
    assert names == {
        f"{stem}.{ending}" for stem in ("pc_7", "pcl_7") for ending in ("raw.gz", "mhd", "loc")
    } | {"labels.json"}


def test_tissue_is_in_victres_labels_at_its_place(written):
    _, labels, frame, folder = written
    whole = read_volume(folder / "pc_7.mhd")
    # The clip of 1.5 mm may fall between voxels of 2 mm.
    assert set(np.unique(whole.values)) | {251} == {0, 1, 29, 50, 200, 250, 251}
    lift = round((frame.origin_mm[2] - whole.origin_mm[2]) / frame.spacing_mm[2])
    inner = whole.values[:, :, lift : lift + frame.shape[2]]
    np.testing.assert_array_equal(inner[(inner != 50) & (labels < 100)],
                                  labels[(inner != 50) & (labels < 100)])  # fmt: skip
    np.testing.assert_array_equal(inner == 200, labels == 151)
    np.testing.assert_allclose(whole.origin_mm[:2], frame.origin_mm[:2])


def test_the_plates_lie_on_either_side_of_the_gap(written):
    compressed, _, _, folder = written
    whole = read_volume(folder / "pc_7.mhd")
    x, _, z = (
        whole.origin_mm[axis] + whole.voxel_mm[axis] * index
        for axis, index in enumerate(np.nonzero(whole.values == 50))
    )
    half = 0.5 * whole.voxel_mm[2]
    gap = (z > compressed.support_z_mm) & (z < compressed.paddle_z_mm)
    assert not gap.any()
    assert z[z < 0].max() == pytest.approx(compressed.support_z_mm, abs=2 * half)
    assert z[z > 0].min() == pytest.approx(compressed.paddle_z_mm, abs=2 * half)
    assert x.min() == pytest.approx(compressed.plate_edge_mm + half, abs=half)
    # A voxel of 2 mm a plate, as thick as VICTRE's 1 mm can be shown.
    assert len(np.unique(z)) == 2


def test_victres_own_cropping_finds_the_part_that_is_written(written):
    _, _, _, folder = written
    whole = read_volume(folder / "pc_7.mhd").values.transpose(2, 1, 0)
    part = read_volume(folder / "pcl_7.mhd").values.transpose(2, 1, 0)
    # VICTRE leaves the highest layer of the upper paddle out.
    np.testing.assert_array_equal(whole[victre_crop(whole)], part[:-1])


def test_lesions_are_listed_where_they_are(written):
    compressed, _, _, folder = written
    places = np.loadtxt(folder / "pc_7.loc", delimiter=",")
    whole, part = read_volume(folder / "pc_7.mhd"), read_volume(folder / "pcl_7.mhd")
    assert len(places) == len(compressed.phantom.lesions)
    for place, label in zip(places[:2], (200, 250), strict=True):
        centre = np.argwhere(whole.values == label).mean(axis=0)
        found = whole.origin_mm + centre * whole.voxel_mm
        assert np.linalg.norm(found - place) < NEAR_MM
    inserted = np.loadtxt(folder / "pcl_7.loc", dtype=int)
    assert inserted[:, 3].tolist() == [2, 1]  # a mass and a cluster; clips have no number
    for (z, x, y, kind), label in zip(inserted, (200, 250), strict=True):
        centre = np.argwhere(part.values == label).mean(axis=0)
        assert np.abs(centre - [x, y, z]).max() <= 1.5, kind


def test_without_lesions_the_cropped_breast_has_victres_name_for_it(tmp_path):
    compressed = make_compressed(VIEWS[0])
    plain = dataclasses.replace(compressed.phantom, lesions=())
    compressed = dataclasses.replace(compressed, phantom=plain)
    write_victre(compressed, *compressed_labels(compressed), tmp_path, 1)
    names = {path.name for path in (tmp_path / "1").iterdir()}
    assert names == {"pc_1.mhd", "pc_1.raw.gz", "pc_1_crop.mhd", "pc_1_crop.raw.gz", "labels.json"}


def test_a_lesion_behind_the_plates_is_not_listed_in_the_cropped_part(tmp_path):
    compressed = make_compressed(VIEWS[0])
    behind = dataclasses.replace(compressed, plate_edge_mm=20.0)  # the cluster lies at x = 17
    write_victre(behind, *compressed_labels(behind), tmp_path, 1)
    assert np.loadtxt(tmp_path / "1" / "pcl_1.loc", dtype=int).tolist()[3] == 2
    assert len(np.loadtxt(tmp_path / "1" / "pc_1.loc", delimiter=",")) == 3


def test_formats_are_written_on_request(tmp_path):
    compressed = make_compressed(VIEWS[1])
    labels, frame = compressed_labels(compressed)
    settings = ExportSettings(compressed_formats=("nrrd", "mha", "victre"), volumes=False)
    write_compressed(tmp_path, compressed, settings, labels, frame, 3)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "compression.json", "convergence.csv", "compressed.nrrd", "compressed.mha", "victre",
            "labels.json", "labels.ctbl",
    }  # fmt: skip
    assert (tmp_path / "victre" / "3" / "pcl_3.raw.gz").is_file()

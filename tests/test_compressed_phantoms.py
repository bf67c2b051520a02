"""Breasts that were compressed before they are read, and lesions that lie in pieces."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile
from make_run import SMALL, invoke, save_breast, write

from mammosim.compression import compress
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import read_phantom
from mammosim.phantom.label_table import find_label_table
from mammosim.phantom.plate_labels import find_plates
from mammosim.projection import project

EXPOSED = {"noise": False, "mas": 100, "kvp": 28}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of a right breast in two views, whose volumes are kept in every form."""
    folder = save_breast(tmp_path_factory.mktemp("own"))
    lesions = [
        {"name": "ball one", "kind": "mass", "diameter_mm": 6, "position_mm": [12, 8, 6]},
        {"name": "specks", "kind": "calcification", "diameter_mm": 5, "position_mm": [13, -9, -5]},
    ]
    path = write(
        folder, phantom={"file": "breast.npz", "lesions": lesions}, laterality="R",
        acquisition=EXPOSED, report={"html": False},
        export={"compressed_formats": ["victre", "nrrd", "mha"]},
    )  # fmt: skip
    result = invoke("run", path, "--output", folder / "out")
    assert result.exit_code == 0, result.output
    return folder / "out"


OWN = ["compressed.nii.gz", "compressed.nrrd", "compressed.mha", "victre/3/pcl_3.mhd",
       "victre/3/pc_3.mhd"]  # fmt: skip


@pytest.mark.parametrize("view", ["CC", "MLO"])
@pytest.mark.parametrize("name", OWN)
def test_own_volumes_say_side_view_and_plates(view, name, finished):
    folder = finished / f"R{view}"
    breast = read_phantom(folder / name)
    said = json.loads((folder / "compression.json").read_text())
    assert breast.laterality == "R"
    assert not any("guessed" in note or "which breast" in note for note in breast.notes)
    assert breast.compressed.view == view
    assert breast.compressed.paddle_z_mm == pytest.approx(said["paddle_z_mm"])
    assert breast.compressed.support_z_mm == pytest.approx(said["support_z_mm"])
    names = {"ball one", "specks"} if name.startswith("comp") else {"mass 1", "calcification 1"}
    assert {lesion.name for lesion in breast.lesions} == names


@pytest.mark.parametrize("view", ["CC", "MLO"])
@pytest.mark.parametrize("name", [OWN[0], OWN[3]])
def test_an_own_volume_gives_the_same_image(view, name, finished, tmp_path):
    """The same detector to the pixel, and the same exposure but for the voxels' steps.

    What is exported are nearest labels on a grid of 1 mm: the skin line moves by up to half a
    voxel, and the density that compression left (1/J) is lost.
    """
    path = write(
        tmp_path, phantom={"file": str(finished / f"R{view}" / name)},
        compression={"model": "none"}, views=[view], acquisition=EXPOSED, report={"html": False},
    )  # fmt: skip
    result = invoke("run", path, "--output", tmp_path / "again")
    assert result.exit_code == 0, result.output
    geometry = [
        json.loads((run / f"R{view}" / "geometry.json").read_text())
        for run in (finished, tmp_path / "again")
    ]
    for values in geometry:
        values.pop("view")
    assert geometry[0] == pytest.approx(geometry[1])
    before, after = (
        tifffile.imread(run / f"R{view}" / "mammogram.tif").astype(float)
        for run in (finished, tmp_path / "again")
    )
    assert np.abs(before - after).mean() < 0.02 * before.mean()
    assert np.corrcoef(np.log(before.ravel() + 1), np.log(after.ravel() + 1))[0, 1] > 0.98


def test_a_breast_compressed_for_one_view_gives_no_other(finished, tmp_path):
    path = write(
        tmp_path, phantom={"file": str(finished / "RCC" / "compressed.nii.gz")},
        compression={"model": "none"}, views=["MLO"],
    )  # fmt: skip
    for command in ("check", "run"):
        result = invoke(command, path, *(["--output", tmp_path / "o"] if command == "run" else []))
        assert result.exit_code == 2
        assert "RMLO: compressed.nii.gz was compressed for CC" in result.output


def test_converting_an_own_volume_says_what_is_lost(finished, tmp_path):
    result = invoke("convert", finished / "RMLO" / "compressed.nii.gz", tmp_path / "c.nrrd")
    assert result.exit_code == 0
    said = " ".join(result.output.split())
    assert "labels.json beside compressed.nii.gz (side, view, plates, lesions) was not con" in said


def test_the_table_of_a_volume(finished):
    table = find_label_table(finished / "RMLO" / "compressed.nii.gz")
    assert (table.laterality, table.compressed_for) == ("R", "MLO")
    assert table.lesions[151].name == "ball one"
    np.testing.assert_allclose(table.rotation, View("MLO", "R").rotation)
    slicer = (finished / "RMLO" / "labels.ctbl").read_text().splitlines()
    assert "1 adipose 245 222 140 255" in slicer
    assert any(line.startswith("151 ball_one ") for line in slicer)
    assert all(len(line.split()) == 6 for line in slicer[1:])


@pytest.mark.parametrize(
    ("content", "message"),
    [("[1]", None), ('{"labels": 3}', None), ("\0", None), ("[" * 100_000, None),
     ('{"format": "mammosim labels", "files": ["x.nii.gz"]}', None),
     ('{"format": "mammosim labels", "files": ["b.npz"]}', "labels.json: cannot be used"),
     ('{"format": "mammosim labels", "files": ["b.npz"], "labels": [{"value": 1, "tissue": "x"}]}',
      "tissue 'x', expected one of"),
     ('{"format": "mammosim labels", "files": ["b.npz"], "labels": [], "laterality": "B"}',
      "laterality 'B', expected L or R"),
     ('{"format": "mammosim labels", "files": ["b.npz"], "labels": [], "laterality": "L", '
      '"compressed_for": "XCC"}', "compressed_for 'XCC'"),
     ('{"format": "mammosim labels", "files": ["b.npz"], "labels": [{"value": 151, '
      '"tissue": "mass", "name": "m", "fill": -1}], "laterality": "L"}', "fill -1")],
)  # fmt: skip
def test_tables_of_others_and_damaged_ones(content, message, tmp_path):
    """Other programs' `labels.json` is passed over; our own that cannot be used is refused."""
    np.savez(tmp_path / "b.npz", labels=slab(), voxel_mm=np.ones(3), origin_mm=np.zeros(3))
    (tmp_path / "labels.json").write_text(content)
    if message is None:
        assert read_phantom(tmp_path / "b.npz").compressed is not None
    else:
        with pytest.raises(InputError, match=message):
            read_phantom(tmp_path / "b.npz")


def slab(gap: int = 48) -> np.ndarray:
    """Fat between two plates, VICTRE's label 50, of two voxels each."""
    labels = np.zeros((60, 80, gap + 4), np.uint8)
    labels[:50, 10:70, 2 : gap + 2] = 1
    labels[:, :, :2] = labels[:, :, gap + 2 :] = 50
    return labels


def save(folder, labels, **changes):
    values = {"voxel_mm": np.ones(3), "origin_mm": np.zeros(3), **changes}
    np.savez(folder / "a.npz", labels=labels, **values)
    return folder / "a.npz"


def test_thickness_is_the_gap_between_the_plates(tmp_path):
    """Also where tissue stands in a plate, and where a plate has a lip at its edge."""
    labels = slab()
    labels[20, 40, 0:2] = 1
    labels[0, :, 50:52] = labels[0, :, 30:32] = 50
    breast = read_phantom(save(tmp_path, labels), compressed_for="CC")
    held = compress(breast, "CC", model="none")
    assert held.thickness_mm == 48.0
    assert (held.support_z_mm, held.paddle_z_mm) == (1.5, 49.5)
    assert held.plate_edge_mm == -0.5
    assert project(held, pixel_mm=1.0).thickness_mm == 48.0


def test_the_detector_begins_where_the_volume_does(tmp_path):
    """A slab that lies flush with the edge is imaged from its first layer on."""
    for labels in (slab(), np.where(slab() == 50, 0, slab())):
        breast = read_phantom(save(tmp_path, labels.astype(np.uint8)), compressed_for="CC")
        paths = project(compress(breast, "CC", model="none"), pixel_mm=1.0)
        assert paths.gantry.detector_edge_mm == -0.5
        assert (paths.length_mm.sum(axis=0)[:, 0] > 0).any()


def test_plates_that_do_not_reach_the_volumes_end(tmp_path):
    labels = slab()
    labels[:12][labels[:12] == 50] = 0
    state = read_phantom(save(tmp_path, labels), compressed_for="CC").compressed
    assert state.edge_mm == 11.5


@pytest.mark.parametrize("order", ["C", "F"])
def test_one_plate_is_no_compression(order):
    labels = np.asarray(slab(), order=order)
    frame = VoxelFrame(np.zeros(3), np.array([0.5, 0.5, 0.25]), labels.shape)
    assert find_plates(labels, frame).paddle_z_mm == 0.25 * 49.5
    labels[:, :, :2] = 0
    assert find_plates(labels, frame) is None


def test_a_compressed_breast_that_is_compressed_again_says_so(tmp_path):
    save(tmp_path, slab())
    keys = {"phantom": {"file": "a.npz", "compressed_for": "CC"}, "laterality": "L"}
    compression = {"thickness_mm": 30, "resolution_mm": 8.0}
    result = invoke("check", write(tmp_path, **keys, views=["CC"], compression=compression))
    assert "warning: LCC: the phantom is already compressed and" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("views", "compression", "why"),
    [(["CC", "MLO"], {"model": "none"}, "compression.model is none"),
     (["CC"], {"model": "none"}, "compression.model is none"),
     (["CC", "MLO"], {"thickness_mm": 30}, "2 views are requested")],
)  # fmt: skip
def test_the_view_of_a_compressed_breast_must_be_known(views, compression, why, tmp_path):
    save(tmp_path, slab())
    path = write(tmp_path, phantom={"file": "a.npz"}, compression=compression, views=views)
    result = invoke("check", path)
    assert result.exit_code == 2
    said = " ".join(result.output.split())
    expected = (
        f"phantom.compressed_for: not given, but the phantom contains plates (label 50) and {why}"
    )
    assert expected in said
    assert invoke("run", path, "--output", tmp_path / "out").exit_code == 2
    assert not (tmp_path / "out").exists()


def test_what_is_not_known_of_a_compressed_breast_is_said(tmp_path):
    breast = read_phantom(save(tmp_path, slab()))
    assert "assumed to be those of CC" in compress(breast, "CC", model="none").notes[0]
    assert any("which breast it is: left was assumed" in note for note in breast.notes)
    keys = {"phantom": {"file": "a.npz"}, "compression": {"thickness_mm": 30, "resolution_mm": 8}}
    result = invoke("check", write(tmp_path, **keys, views=["CC"]))
    assert result.exit_code == 0
    said = " ".join(result.output.split())
    assert "warning: LCC: the phantom contains plates, but phantom.compressed_for is not" in said
    assert "warning: a compressed breast does not show which breast it is: left was assumed" in said
    with pytest.raises(InputError, match="compressed_for: found 'XCC'"):
        read_phantom(tmp_path / "a.npz", compressed_for="XCC")


def scene(voxel: float = 0.5) -> tuple[np.ndarray, float]:
    labels = np.ones((60, 60, 60), np.uint8)
    labels[-2:] = 0
    return labels, voxel


def read_pieces(folder, labels, voxel, **keys):
    path = save(folder, labels, voxel_mm=np.full(3, voxel))
    return read_phantom(path, laterality="L", **keys)


def test_pieces_of_a_mass_are_one_lesion(tmp_path):
    """A mass with spicules that broke up, and single voxels far away from it."""
    labels, voxel = scene()
    labels[20:36, 20:36, 20:36] = 200
    labels[38:40, 26:28, 26:28] = 200  # a gap of 2 voxels, 1 mm
    labels[5, 5, 5] = labels[50, 50, 50] = 200
    breast = read_pieces(tmp_path, labels, voxel, min_volume_mm3=0.2)
    assert [lesion.name for lesion in breast.lesions] == ["mass 1"]
    assert breast.lesions[0].volume_mm3 == (16**3 + 8 + 2) * voxel**3
    assert "4 pieces of mass were merged into one lesion" in " ".join(breast.notes)
    assert len(read_pieces(tmp_path, labels, voxel, merge_mm=0, min_volume_mm3=0).lesions) == 4


@pytest.mark.parametrize(("gap_voxels", "lesions"), [(3, 1), (4, 1), (5, 2), (9, 2)])
def test_the_gap_is_measured_from_face_to_face(gap_voxels, lesions, tmp_path):
    labels, voxel = scene()
    labels[10:20, 10:20, 10:20] = 200
    labels[10:20, 10:20, 20 + gap_voxels : 30 + gap_voxels] = 200
    breast = read_pieces(tmp_path, labels, voxel)
    assert len(breast.lesions) == lesions
    assert any("pieces of mass" in note for note in breast.notes) == (lesions == 1)


def test_two_small_masses_apart_stay_two(tmp_path):
    """No piece reaches the least volume, so that none is a crumb of another."""
    labels, voxel = scene(0.2)
    labels[10, 10, 10] = labels[40, 40, 40] = 200
    assert len(read_pieces(tmp_path, labels, voxel).lesions) == 2


def test_clips_and_calcifications_are_counted_as_before(tmp_path):
    labels, voxel = scene()
    labels[10, 10, 10] = labels[12, 10, 10] = 251
    labels[30, 30, 30] = labels[34, 30, 30] = 250
    kinds = [lesion.kind for lesion in read_pieces(tmp_path, labels, voxel).lesions]
    assert kinds == ["calcification", "clip", "clip"]


def test_noise_of_masses_is_refused(tmp_path):
    labels, voxel = scene()
    labels[:58:2, ::2, ::2] = 200
    with pytest.raises(InputError, match=r"separate pieces of masses, expected at most"):
        read_pieces(tmp_path, labels, voxel)


def test_the_side_is_never_guessed_silently(tmp_path):
    labels, voxel = scene()
    path = save(tmp_path, labels, voxel_mm=np.full(3, voxel))
    assert any("which breast it is: left was assumed" in n for n in read_phantom(path).notes)
    assert not any("which breast" in note for note in read_phantom(path, laterality="R").notes)
    assert SMALL["projection"]["pixel_mm"] == 0.8

"""Lesions whose shape comes from a file: masks of voxels and closed surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from make_phantom import half_ellipsoid_breast
from make_run import SMALL, invoke, save_breast, write
from scipy.spatial.transform import Rotation

from mammosim.errors import InputError
from mammosim.phantom import LesionSettings, insert_lesions
from mammosim.phantom.lesion_shapes import read_shape

CENTRE = (14.0, 1.0, -2.0)


@pytest.fixture(scope="module")
def breast():
    return half_ellipsoid_breast(voxel_mm=1.0)


def inserted(breast, file, **keys):
    entry = LesionSettings(name="it", kind="mass", file=str(file), position_mm=CENTRE, **keys)
    return insert_lesions(breast, [entry], np.random.default_rng(1))


def offsets_mm(breast) -> np.ndarray:
    """Voxel centres of its only lesion from the place asked for."""
    index = np.argwhere(breast.labels == breast.lesions[0].label)
    return breast.frame.position_mm(index) - CENTRE


def save_surface(path, mesh, moved=(100.0, -20.0, 7.0)):
    mesh = mesh.copy()
    mesh.apply_translation(moved)
    mesh.export(path)
    return path


def step_mask() -> np.ndarray:
    """A body that looks another way along every axis: 8 x 5 x 3 mm of voxels of 0.5 mm."""
    mask = np.zeros((20, 14, 10), np.uint8)
    mask[2:18, 2:12, 2:4] = 1
    mask[2:6, 2:12, 2:8] = 7
    mask[2:18, 2:4, 2:8] = 1
    return mask


def whole_fill(shape, voxel_mm=1.0, turn=(0.0, 0.0, 0.0)):
    """Filled parts of a grid around a shape, whose centre lies between its voxels."""
    count = int(2 * shape.radius_mm / voxel_mm) + 5
    linear = Rotation.from_euler("xyz", turn, degrees=True).as_matrix() / voxel_mm
    start = 0.5 * count - 0.37 - linear @ shape.centre_mm
    return shape.filled(np.column_stack([linear, start]), (count, count, count))


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "off"])
def test_a_surface_fills_its_volume(ending, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=4.0)
    shape = read_shape(save_surface(tmp_path / f"ball.{ending}", ball))
    assert shape.radius_mm == pytest.approx(4.0, rel=1e-3)
    assert shape.volume_mm3 == pytest.approx(ball.volume, rel=1e-5)
    np.testing.assert_allclose(shape.centre_mm, [100, -20, 7], atol=1e-3)
    filled = whole_fill(shape, voxel_mm=0.8)
    assert filled.sum() * 0.8**3 == pytest.approx(ball.volume, rel=5e-3)
    assert filled.min() == 0.0
    assert filled.max() == 1.0


def test_parts_of_voxels_at_a_face_along_x_are_exact(tmp_path):
    box = trimesh.creation.box((4.3, 6.0, 6.0))
    shape = read_shape(save_surface(tmp_path / "box.stl", box, (0, 0, 0)))
    placing = np.column_stack([np.eye(3), [10.0, 7.5, 7.5]])  # from 7.85 to 12.15 along x
    filled = shape.filled(placing, (20, 16, 16))
    np.testing.assert_allclose(filled[7:14, 8, 8], [0, 0.65, 1, 1, 1, 0.65, 0], atol=1e-5)
    assert filled.sum() == pytest.approx(box.volume, rel=1e-5)


def test_a_surface_turned_inside_out_is_the_same(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    inside_out = ball.copy()
    inside_out.invert()
    shapes = [
        read_shape(save_surface(tmp_path / f"{number}.stl", mesh))
        for number, mesh in enumerate((ball, inside_out))
    ]
    np.testing.assert_allclose(*(whole_fill(shape) for shape in shapes), atol=1e-9)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (20.0, -35.0, 50.0)])
def test_a_mask_keeps_its_volume_where_it_is_turned(turn, tmp_path):
    np.savez(tmp_path / "m.npz", labels=step_mask(), voxel_mm=0.5, origin_mm=np.zeros(3))
    shape = read_shape(tmp_path / "m.npz")
    assert shape.volume_mm3 == np.count_nonzero(step_mask()) / 8
    filled = whole_fill(shape, turn=turn)
    assert filled.sum() == pytest.approx(shape.volume_mm3, rel=1e-9)
    assert filled.max() <= 1.15  # points of a turned mask lie unevenly in a voxel, 2 of 64 or so


def test_parts_in_a_file_are_parts_of_its_voxels(tmp_path):
    np.savez(
        tmp_path / "m.npz", labels=0.25 * (step_mask() > 0), voxel_mm=0.5, origin_mm=np.zeros(3)
    )
    assert read_shape(tmp_path / "m.npz").volume_mm3 == np.count_nonzero(step_mask()) / 32


def test_a_mask_lies_in_the_breast_as_in_its_file(breast, tmp_path):
    np.savez(tmp_path / "m.npz", labels=step_mask(), voxel_mm=0.5, origin_mm=np.full(3, 99.0))
    made = inserted(breast, tmp_path / "m.npz")
    lesion = made.lesions[0]
    offsets = offsets_mm(made)
    true = np.count_nonzero(step_mask()) / 8
    assert lesion.volume_mm3 == pytest.approx(true)
    assert lesion.fill * len(offsets) == pytest.approx(true)
    middle = (np.argwhere(step_mask()).mean(axis=0) - [9.5, 6.5, 4.5]) * 0.5
    np.testing.assert_allclose(offsets.mean(axis=0), middle, atol=0.35)
    assert (np.ptp(offsets, axis=0) + 1 >= [7, 4, 2]).all()
    assert (np.ptp(offsets, axis=0) + 1 <= [9, 6, 4]).all()


def test_a_surface_is_turned_and_scaled(breast, tmp_path):
    rod = trimesh.creation.box((6.0, 1.0, 1.0))
    file = save_surface(tmp_path / "rod.stl", rod)
    made = inserted(breast, file, rotation_deg=(0, 0, 90), diameter_mm=2 * np.sqrt(38.0))
    assert made.lesions[0].volume_mm3 == pytest.approx(6.0 * 8, rel=1e-4)  # twice as large
    extent = np.ptp(offsets_mm(made), axis=0) + 1
    assert extent[1] == pytest.approx(12.0, abs=1.01)  # x was turned to y
    assert max(extent[0], extent[2]) <= 4.0


def test_what_is_smaller_than_a_voxel_is_one_that_is_filled_in_part(breast, tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
    entry = LesionSettings(
        name="speck", kind="calcification", position_mm=CENTRE,
        file=str(save_surface(tmp_path / "b.stl", ball)),
    )  # fmt: skip
    made = insert_lesions(breast, [entry], np.random.default_rng(1))
    assert np.count_nonzero(made.labels == made.lesions[0].label) == 1
    assert made.lesions[0].fill == pytest.approx(ball.volume, rel=1e-3)


def bad_files(folder):
    """Files that are no lesion's shape, and what is said of them."""
    holes = trimesh.creation.icosphere(subdivisions=1)
    holes.update_faces(np.arange(len(holes.faces)) > 3)
    holes.export(folder / "holes.stl")
    np.savez(folder / "none.npz", labels=np.zeros((4, 4, 4), int), voxel_mm=1, origin_mm=[0, 0, 0])
    np.savez(folder / "odd.npz", labels=np.full((4, 4, 4), 2.5), voxel_mm=1, origin_mm=np.zeros(3))
    np.save(folder / "size.npy", np.ones((3, 3, 3), np.uint8))
    (folder / "text.stl").write_text("no surface")
    (folder / "volume.vtk").write_text("")
    (folder / "mass.h5").write_text("no HDF5")
    return {
        "holes.stl": "has holes: 6 of",
        "none.npz": "all 64 voxels are 0",
        "odd.npz": "values from 2.5 to 2.5, expected",
        "size.npy": "does not give its voxel size; set the lesion's voxel_mm",
        "text.stl": r"(cannot be read as a surface|holds no triangles)",
        "volume.vtk": "meshio convert volume.vtk volume.stl",
        "mass.h5": r"(cannot be read, expected HDF5|HDF5 files need h5py)",
        "gone.stl": "no such file",
        "gone.nii.gz": "no such file",
    }


def test_files_that_are_no_shape_are_refused(tmp_path):
    for name, message in bad_files(tmp_path).items():
        with pytest.raises(InputError, match=message):
            read_shape(tmp_path / name)


@pytest.mark.parametrize("phantom", [{"file": "breast.npz"}, {"generate": {"voxel_mm": 4.0}}])
def test_check_names_the_lesion_whose_file_is_bad(phantom, tmp_path):
    save_breast(tmp_path)
    bad_files(tmp_path)
    lesions = [
        {"name": "a", "kind": "mass", "file": "holes.stl"},
        {"name": "b", "kind": "mass", "file": "none.npz"},
    ]
    path = write(tmp_path, phantom={**phantom, "lesions": lesions}, **SMALL)
    result = invoke("check", path)
    assert result.exit_code == 2
    said = " ".join(result.output.split())
    assert "phantom.lesions.0.file: " in said
    assert "has holes" in said
    assert "phantom.lesions.1.file: " in said
    assert "all 64 voxels are 0" in said


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"voxel_mm": 1.0}, "voxel_mm belongs to a lesion with a file"),
        ({"rotation_deg": (1, 2, 3)}, "rotation_deg belongs to a lesion with a file"),
        ({"file": "a.stl", "margin": "smooth"}, "margin does not belong to a lesion with a file"),
    ],
)
def test_keys_that_do_not_belong_together(keys, message):
    with pytest.raises(ValueError, match=message):
        LesionSettings(name="a", kind="mass", **keys)


def test_a_library_in_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "m.h5", "w") as file:
        file["volume"] = step_mask().transpose(2, 1, 0)
    np.savez(tmp_path / "m.npz", labels=step_mask(), voxel_mm=0.05, origin_mm=np.zeros(3))
    stored, plain = read_shape(tmp_path / "m.h5", 0.05), read_shape(tmp_path / "m.npz")
    np.testing.assert_allclose(stored.centre_mm, plain.centre_mm)
    assert stored.volume_mm3 == pytest.approx(plain.volume_mm3)


def test_another_shape_is_another_run(tmp_path):
    from mammosim.pipeline import load_config
    from mammosim.pipeline.folder.run_identity import InputHashes, hash_of

    save_breast(tmp_path)
    hashes = set()
    for size in (3, 4):
        np.savez(
            tmp_path / "m.npz", labels=np.ones((size,) * 3), voxel_mm=1.0, origin_mm=np.zeros(3)
        )
        lesions = [{"name": "a", "kind": "mass", "file": "m.npz"}]
        config = load_config(write(tmp_path, phantom={"file": "breast.npz", "lesions": lesions}))
        hashes.add(hash_of(config, InputHashes.of(config)))
    assert len(hashes) == 2


def test_a_grid_of_many_voxels_takes_one_line_each(tmp_path):
    box = trimesh.creation.box((3.3, 110.0, 4.0))
    shape = read_shape(save_surface(tmp_path / "box.stl", box, (0, 0, 0)))
    placing = np.column_stack([np.diag([1.0, 10.0, 1.0]), [4.0, 600.0, 3.5]])
    filled = shape.filled(placing, (9, 1200, 8))  # voxels of 0.1 mm along y
    assert filled.sum() / 10 == pytest.approx(box.volume, rel=2e-3)
    assert filled.max() == 1.0

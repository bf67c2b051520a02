"""The thesis' input file: a cube of 16-bit codes, x from the nipple, y fastest."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.phantom import PhantomSettings, read_phantom
from mammosim.phantom.size import expected_voxels
from mammosim.pipeline import load_config

CASES = sorted((Path(__file__).parents[1] / "configs" / "thesis").glob("*.yaml"))


def save_cube(path: Path, codes: np.ndarray) -> Path:
    """Write codes [x, y, z] of the thesis' axes, one by one in the order of its `inputRead`."""
    nx, ny, nz = codes.shape
    with path.open("wb") as stream:
        for i in range(nx):
            for k in range(nz):
                for j in range(ny):
                    stream.write(struct.pack("<h", codes[i, j, k]))
    return path


def cube_of_tissue(side: int = 12) -> np.ndarray:
    """A box of fat in air, 6 x 7 x 8 codes, uneven in every axis; the chest wall is at x = 9."""
    codes = np.full((side, side, side), 220, np.int16)
    codes[4:10, 2:9, 3:11] = 203
    codes[4, 5, 4] = 201  # an abnormality at the tip, y index 3 and z index 1 of the tissue
    codes[8, 3, 9] = 216  # gland near the chest wall, y index 1 and z index 6
    return codes


def test_codes_come_into_the_breast_frame_cropped(tmp_path):
    codes = cube_of_tissue()
    breast = read_phantom(save_cube(tmp_path / "b.bin", codes), labels="thesis")
    assert breast.labels.shape == (6, 7, 8)
    np.testing.assert_array_equal(breast.voxel_mm, 1.0)
    np.testing.assert_array_equal(np.argwhere(breast.labels == 29), [[1, 1, 6]])
    (mass,) = breast.lesions
    assert mass.kind == "mass"
    # x from the chest wall, y from the middle of 7 layers, z the thesis' own index.
    np.testing.assert_allclose(mass.position_mm, [5.0, 0.0, 1.0])
    np.testing.assert_allclose(breast.origin_mm, [0.0, -3.0, 0.0])
    assert (breast.labels != 0).all()
    assert "1 mm was assumed" in breast.notes[0]


def test_every_voxel_is_where_the_thesis_puts_it(tmp_path):
    codes = np.random.default_rng(3).choice([203, 216], (5, 5, 5)).astype(np.int16)
    breast = read_phantom(save_cube(tmp_path / "b.bin", codes), labels="thesis")
    label_of = {203: 1, 216: 29}
    for i, j, k in np.ndindex(5, 5, 5):
        assert breast.labels[4 - i, j, k] == label_of[int(codes[i, j, k])]


def test_unknown_codes_are_fat_and_noted(tmp_path):
    codes = cube_of_tissue()
    codes[6, 4, 5], codes[6, 4, 6], codes[0, 0, 0] = 7, 7, -3
    breast = read_phantom(save_cube(tmp_path / "b.bin", codes), labels="thesis")
    assert any("3 voxels of b.bin hold codes that" in note and "-3, 7" in note
               for note in breast.notes)  # fmt: skip
    # As in the thesis, what is not air counts as tissue when the cube is cropped.
    assert breast.labels.shape == (10, 9, 11)
    assert np.count_nonzero(breast.labels == 1) == 6 * 7 * 8 - 2 + 1


@pytest.mark.parametrize("size", [0, 1, 2 * 5**3 - 2, 2 * 5**3 + 1, 5**3])
def test_what_is_no_cube_is_refused(tmp_path, size):
    path = tmp_path / "b.bin"
    path.write_bytes(bytes(size))
    with pytest.raises(InputError, match=rf"holds {size} bytes, expected a cube of 2-byte codes"):
        read_phantom(path, labels="thesis")


def test_the_size_is_known_from_the_files_length(tmp_path):
    path = save_cube(tmp_path / "b.bin", cube_of_tissue())
    assert expected_voxels(PhantomSettings(file=str(path))) == (12**3, 1.0)
    path.write_bytes(bytes(100))
    with pytest.raises(InputError, match="holds 100 bytes, expected a cube"):
        expected_voxels(PhantomSettings(file=str(path)))


def test_only_air_is_refused(tmp_path):
    path = save_cube(tmp_path / "b.bin", np.full((4, 4, 4), 220, np.int16))
    with pytest.raises(InputError, match=r"holds no tissue, every code is 220 \(air\)"):
        read_phantom(path, labels="thesis")


def test_another_label_map_is_refused_by_its_codes(tmp_path):
    path = save_cube(tmp_path / "b.bin", cube_of_tissue())
    with pytest.raises(InputError, match="label 203"):
        read_phantom(path)


def test_there_are_five_cases():
    assert len(CASES) == 5


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_each_case_is_a_configuration_with_the_plates_of_its_name(path):
    config = load_config(path)
    upper, lower = (float(word) for word in path.stem.split("-"))
    assert config.compression.paddle_z_mm == upper
    assert config.compression.support_z_mm == lower
    assert config.compression.solver == "relaxation"
    assert config.phantom.labels == "thesis"

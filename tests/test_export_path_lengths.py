"""Path lengths that were saved: read back whole, exposed again, and refused where broken."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from make_records import make_gantry, make_paths

import mammosim
from mammosim.errors import InputError
from mammosim.export import write_path_lengths
from mammosim.geometry import View

VIEWS = [View("CC", "L"), View("MLO", "R", 50.0)]


@pytest.fixture
def saved(tmp_path):
    """A file of path lengths whose `attenuating_mm` differs from its `length_mm`."""

    def save(view: View = VIEWS[0]):
        plain = make_paths(view, make_gantry(view, pixel_mm=1.0))
        paths = dataclasses.replace(plain, attenuating_mm=plain.length_mm * np.float32(1.1))
        write_path_lengths(paths, tmp_path / "path_lengths.npz")
        return paths, tmp_path / "path_lengths.npz"

    return save


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_every_field_comes_back(saved, view):
    paths, file = saved(view)
    found = mammosim.load_path_lengths(file)
    for field in dataclasses.fields(paths):
        before, after = getattr(paths, field.name), getattr(found, field.name)
        if isinstance(before, np.ndarray):
            assert after.dtype == before.dtype
            np.testing.assert_array_equal(after, before)
        else:
            assert after == before, field.name


def test_exposed_again_it_is_the_same_picture_bit_by_bit(saved):
    paths, file = saved()
    direct = mammosim.expose(paths, seed=5)
    again = mammosim.expose(mammosim.load_path_lengths(file), seed=5)
    assert again.for_processing.tobytes() == direct.for_processing.tobytes()
    assert again.for_presentation.tobytes() == direct.for_presentation.tobytes()
    assert (again.mas, again.dose_mgy) == (direct.mas, direct.dose_mgy)
    assert again.measures == direct.measures


def rewritten(file, **changes):
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, value in changes.items():
        if value is None:
            del arrays[name]
        else:
            arrays[name] = value
    np.savez(file, **arrays)
    return file


def test_files_that_are_none_are_refused(tmp_path, saved):
    _, file = saved()
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(InputError, match=r"text\.npz: cannot be read as a NumPy archive"):
        mammosim.load_path_lengths(tmp_path / "text.npz")
    with pytest.raises(InputError, match=r"none\.npz: cannot be read"):
        mammosim.load_path_lengths(tmp_path / "none.npz")
    with pytest.raises(InputError, match=r"found no array geometry; expected an archive written"):
        mammosim.load_path_lengths(rewritten(file, geometry=None))


def test_arrays_that_do_not_fit_are_refused(saved):
    paths, file = saved()
    with pytest.raises(InputError, match=r"found length_mm of float64 .*, expected float32 \(5"):
        mammosim.load_path_lengths(rewritten(file, length_mm=paths.length_mm.astype(float)))
    fitting = rewritten(file, length_mm=paths.length_mm, materials=np.array(["gland"]))
    with pytest.raises(InputError, match=r"found materials of shape \(1,\), expected one entry"):
        mammosim.load_path_lengths(fitting)


def test_a_geometry_that_is_not_understood_is_refused(saved):
    _, file = saved()
    for text in ("{", "{}", '{"gantry": {"view": {}}}'):
        with pytest.raises(InputError, match="geometry cannot be understood"):
            mammosim.load_path_lengths(rewritten(file, geometry=np.array(text)))

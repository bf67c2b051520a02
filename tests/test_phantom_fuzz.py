"""Any header at all: a phantom or a plain sentence, and no memory beyond the file's honest size."""

from __future__ import annotations

import struct
import tempfile
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from make_volumes import (
    FORMATS,
    SERIES,
    save,
    save_itk,
    save_vctx,
    save_victre,
    small_breast,
    vctx_description,
    victre_header,
)

from mammosim.errors import InputError
from mammosim.phantom import BreastPhantom, read_phantom
from mammosim.phantom.readers.axes import AXIS_OF_LETTER, are_axes
from mammosim.phantom.voxels import read_volume

QUICK = settings(
    max_examples=40, deadline=None, derandomize=True, database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)  # fmt: skip

MAX_BYTES = 24 << 20
"""Files of a few kilobytes: NumPy arrays may not take more than the readers' own buffers."""

AXES = [
    a + b + c for a in AXIS_OF_LETTER for b in AXIS_OF_LETTER for c in AXIS_OF_LETTER
    if are_axes(a + b + c)
]  # fmt: skip

WORDS = st.one_of(
    st.integers(-(10**20), 10**20).map(str),
    st.floats(width=64).map(str),
    st.sampled_from(
        ["", "a", "7 9 11", "0", "-1", "nan nan nan", "1e400", "7 9 11 1", "\x00", "½"]
    ),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\n\r"), max_size=12),
    st.lists(st.floats(width=32).map(str), min_size=2, max_size=9).map(" ".join),
)
"""What may stand after a key."""


def phantom_or_plain_sentence(path: Path) -> None:
    """The whole contract of a reader towards a file that it knows nothing of."""
    tracemalloc.start()
    found: BreastPhantom | None = None
    problems: tuple[str, ...] = ()
    try:
        found = read_phantom(path)
    except InputError as error:
        problems = error.problems
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < MAX_BYTES
    if found is None:
        assert problems
        assert all(problem.strip() for problem in problems)
        return
    assert np.isfinite(found.voxel_mm).all()
    assert (found.voxel_mm > 0).all()
    assert np.isfinite(found.origin_mm).all()


@pytest.fixture(scope="module", params=FORMATS)
def sound(request, tmp_path_factory) -> tuple[str, dict[str, bytes]]:
    """Name of a sound phantom in each format, and the content of its files."""
    folder = tmp_path_factory.mktemp("sound")
    suffix = request.param
    path = save(folder / f"b.{suffix.lstrip('.')}", small_breast())
    files = path.iterdir() if suffix == SERIES else folder.iterdir()
    return suffix, {str(file.relative_to(folder)): file.read_bytes() for file in files}


@QUICK
@given(data=st.data())
def test_a_file_with_some_bytes_changed(sound, data):
    suffix, contents = sound
    name = data.draw(st.sampled_from(sorted(contents)))
    content = bytearray(contents[name])
    # Most changes in the header, where they do the most.
    end = data.draw(st.sampled_from([min(400, len(content)), len(content)]))
    for _ in range(data.draw(st.integers(1, 6))):
        content[data.draw(st.integers(0, end - 1))] = data.draw(st.integers(0, 255))
    with tempfile.TemporaryDirectory() as folder:
        for other, bytes_ in contents.items():
            (Path(folder) / other).parent.mkdir(exist_ok=True)
            (Path(folder) / other).write_bytes(content if other == name else bytes_)
        phantom_or_plain_sentence(Path(folder) / f"b.{suffix.lstrip('.')}")


@QUICK
@given(
    changes=st.dictionaries(
        st.sampled_from(
            ["DimSize", "ElementSpacing", "Offset", "TransformMatrix", "ElementType", "NDims",
             "ElementDataFile", "AnatomicalOrientation", "BinaryDataByteOrderMSB", "BinaryData",
             "ElementNumberOfChannels", "CompressedData", "HeaderSize"]
        ),
        WORDS, min_size=1, max_size=3,
    )
)  # fmt: skip
def test_a_metaimage_header_with_any_words(changes):
    with tempfile.TemporaryDirectory() as folder:
        path = save_victre(Path(folder))
        path.write_text(victre_header(**changes), encoding="utf-8")
        phantom_or_plain_sentence(path)


@QUICK
@given(
    key=st.sampled_from(["type", "dimension", "space", "sizes", "space directions", "kinds",
                         "encoding", "space origin", "endian", "byte skip", "data file"]),
    word=WORDS,
)  # fmt: skip
def test_an_nrrd_header_with_any_words(key, word):
    with tempfile.TemporaryDirectory() as folder:
        path = save_itk(Path(folder) / "b.nrrd", small_breast())
        header, _, voxels = path.read_bytes().partition(b"\n\n")
        lines = [line for line in header.split(b"\n") if not line.startswith(f"{key}:".encode())]
        lines.append(f"{key}: {word}".encode())
        path.write_bytes(b"\n".join(lines) + b"\n\n" + voxels)
        phantom_or_plain_sentence(path)


@QUICK
@given(
    at=st.sampled_from([0, 40, 42, 44, 46, 70, 72, 76, 80, 84, 88, 108, 112, 116, 123, 252, 254,
                        256, 268, 280, 284, 296, 344]),
    value=st.one_of(st.integers(-(2**31), 2**31 - 1).map(lambda n: struct.pack("<i", n)),
                    st.floats(width=32).map(lambda x: struct.pack("<f", x))),
    zipped=st.booleans(),
)  # fmt: skip
def test_a_nifti_header_with_any_numbers(at, value, zipped):
    with tempfile.TemporaryDirectory() as folder:
        path = save_itk(Path(folder) / "b.nii", small_breast())
        content = bytearray(path.read_bytes())
        content[at : at + 4] = value
        if zipped:
            path = path.with_suffix(".nii.gz")
            packer = zlib.compressobj(wbits=31)
            path.write_bytes(packer.compress(content) + packer.flush())
        else:
            path.write_bytes(content)
        phantom_or_plain_sentence(path)


@QUICK
@given(
    fields=st.dictionaries(
        st.sampled_from(["X", "Y", "Z", "SX", "SY", "SZ", "order", "type", "bits"]), WORDS,
        min_size=1, max_size=3,
    )
)  # fmt: skip
def test_an_openvct_description_with_any_words(fields):
    with tempfile.TemporaryDirectory() as folder:
        description = vctx_description((7, 9, 11), **fields)
        path = save_vctx(Path(folder) / "b.vctx", small_breast(), description)
        phantom_or_plain_sentence(path)


@QUICK
@given(
    suffix=st.sampled_from([".mhd", ".mha", ".nrrd", ".nii", ".nii.gz"]),
    axes=st.sampled_from(AXES),
    dtype=st.sampled_from(["u1", "i2", "u2", "i4", "f4"]),
    shape=st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(1, 6)),
    seed=st.integers(0, 2**32),
)
def test_a_sound_header_is_read_as_it_says(suffix, axes, dtype, shape, seed):
    """Any shape, direction and type: each voxel where SimpleITK's own geometry puts it."""
    values = np.random.default_rng(seed).integers(0, 90, shape).astype(dtype)
    with tempfile.TemporaryDirectory() as folder:
        volume = read_volume(save_itk(Path(folder) / f"b{suffix}", values, axes))
    where = [AXIS_OF_LETTER[letter] for letter in axes]
    turned = values[tuple(slice(None, None, sense) for _, sense in where)]
    np.testing.assert_array_equal(
        volume.values, turned.transpose(np.argsort([axis for axis, _ in where]))
    )

"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import json
import math
import os

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.export import whole_file, write_json, write_text


def test_the_file_appears_only_at_the_end(tmp_path):
    path = tmp_path / "new" / "table.csv"
    with whole_file(path) as part:
        part.write_text("a,b\n")
        assert part.parent == path.parent
        assert part.suffix == path.suffix
        assert not path.exists()
    assert path.read_text() == "a,b\n"
    assert os.listdir(path.parent) == ["table.csv"]


def test_an_exception_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")

    def interrupted() -> None:
        with whole_file(path) as part:
            part.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["table.csv"]


def test_a_folder_that_cannot_be_made_is_an_input_error_with_path_and_reason(tmp_path):
    (tmp_path / "run").write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"run/table\.csv: cannot be written \(.+\)"):
        write_text(tmp_path / "run" / "table.csv", "text")


def test_the_systems_own_reason_is_found_inside_a_librarys(tmp_path):
    def wrapped() -> None:
        with whole_file(tmp_path / "image.dcm"):
            try:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError as error:
                raise OSError("With tag (7FE0,0010) got exception:\na long story") from error

    with pytest.raises(InputError, match=rf"\({os.strerror(errno.ENOSPC)}\)$"):
        wrapped()


def test_a_reason_without_number_is_given_by_its_first_line(tmp_path):
    def half() -> None:
        with whole_file(tmp_path / "image.tif"):
            raise OSError("28800 requested and 1944 written\nand more")

    with pytest.raises(InputError, match=r"\(28800 requested and 1944 written\)$"):
        half()


def test_json_takes_numpy_and_writes_null_for_what_json_has_not(tmp_path):
    value = {"a": np.float32(0.5), "b": np.arange(3), "c": (math.nan, math.inf), "d": "ö"}
    write_json(tmp_path / "x.json", value)
    text = (tmp_path / "x.json").read_text(encoding="utf-8")
    assert json.loads(text) == {"a": 0.5, "b": [0, 1, 2], "c": [None, None], "d": "ö"}
    assert "NaN" not in text
    assert text.endswith("}\n")

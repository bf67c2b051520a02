"""Settings and YAML: every mistake at once, in words, with the nearest known key."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from pydantic import Field

from mammosim.config import Settings, parse_value, read_yaml, to_settings, write_yaml
from mammosim.errors import InputError


class Inner(Settings):
    """Inner settings."""

    length_mm: float = Field(1.0, gt=0)
    """A length, mm."""

    kind: Literal["one", "two"] = "one"
    """A choice."""


class Outer(Settings):
    """Outer settings."""

    name: str
    """A name."""

    inner: Inner = Inner()
    """Inner."""

    many: tuple[Inner, ...] = ()
    """Many."""

    maybe: float | None = None
    """Perhaps a number."""


def test_all_mistakes_come_at_once():
    values = {
        "inner": {"length_mm": -1, "lenght_mm": 2, "kind": "three"},
        "many": [{"length_mm": 1}, {"length_mm": "x"}],
        "maybe": "much",
    }
    with pytest.raises(InputError) as caught:
        to_settings(Outer, values, "file.yaml")
    assert set(caught.value.problems) == {
        "file.yaml: name: missing; it must be given",
        "file.yaml: inner.length_mm: found -1, expected greater than 0",
        "file.yaml: inner.lenght_mm: unknown key; did you mean 'length_mm'?",
        "file.yaml: inner.kind: found 'three', expected 'one' or 'two'",
        "file.yaml: many.1.length_mm: found 'x', expected a valid number",
        "file.yaml: maybe: found 'much', expected a valid number",
    }


@pytest.mark.parametrize("value", [True, "1.0", [1.0], float("nan"), float("inf")])
def test_a_number_must_be_a_number(value):
    with pytest.raises(InputError, match=r"inner\.length_mm: found"):
        to_settings(Outer, {"name": "a", "inner": {"length_mm": value}}, "f")


def test_numpy_numbers_are_numbers():
    settings = to_settings(Inner, {"length_mm": np.float32(2.5)}, "f")
    assert settings.length_mm == 2.5


@pytest.mark.parametrize("values", [3, "text", [1, 2]])
def test_a_section_must_be_a_mapping(values):
    with pytest.raises(InputError, match="expected a mapping of keys"):
        to_settings(Outer, values, "f", ("section",))


@pytest.mark.parametrize("key", ["Names", "float", "literal[x", "", "None"])
def test_unknown_keys_may_look_like_anything(key):
    with pytest.raises(InputError, match="unknown key; known keys: kind, length_mm"):
        to_settings(Inner, {key: 1}, "f")


def test_unknown_key_without_a_near_one_lists_the_known():
    with pytest.raises(InputError, match="zzz: unknown key; known keys: kind, length_mm"):
        to_settings(Inner, {"zzz": 1}, "f")


def test_missing_file():
    with pytest.raises(InputError, match=r"nowhere\.yaml: no such file"):
        read_yaml("nowhere.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1, 2", r"line \d+: not valid YAML"),
        ("a: 1\na: 2", r"line \d+: not valid YAML"),
        ("a: !!python/object/apply:os.system [ls]", "not valid YAML"),
        ("? [1, 2]\n: 3", "not plain YAML"),
        ("2024-05-01: 3", "not plain YAML"),
        ('a: "\\ud800"', "which is not valid text"),
        ('"\\udc00": 1', "which is not valid text"),
        ("a: &x [*x]", r"an alias that refers to itself"),
        (
            "a: &a [x, x, x, x, x, x, x, x, x]\n"
            + "".join(
                f"{b}: &{b} [*{a}, *{a}, *{a}, *{a}, *{a}, *{a}, *{a}, *{a}, *{a}]\n"
                for a, b in zip("abcdefgh", "bcdefghi", strict=True)
            ),
            r"more than \d+ values",
        ),
    ],
)
def test_what_is_not_plain_yaml_is_refused(text, message, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_yaml(path)


def test_a_file_without_an_end_is_refused():
    with pytest.raises(
        InputError, match=r"/dev/zero: cannot be read \(it is a device, expected a file\)"
    ):
        read_yaml("/dev/zero")


def test_bytes_are_not_text(tmp_path):
    path = tmp_path / "bytes.yaml"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="not a text file in UTF-8"):
        read_yaml(path)


def test_exponents_are_numbers():
    assert parse_value("1e-3", "here") == 1e-3


def test_written_yaml_reads_back(tmp_path):
    values = {"b": 1, "a": {"list": [1.5, None, "x: y"], "yes": True}}
    write_yaml(values, tmp_path / "c.yaml")
    assert read_yaml(tmp_path / "c.yaml") == values
    assert list(read_yaml(tmp_path / "c.yaml")) == ["b", "a"]


@pytest.mark.parametrize("text", ["{", "[" * 100_000, '{"a": "\\ud800"}'])
def test_what_is_not_plain_json_is_refused(text, tmp_path):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"not valid JSON|which is not valid text"):
        read_yaml(path)

"""YAML files in and out: plain values only, duplicates refused, written whole or not at all."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from mammosim.errors import InputError

MOST_CHARACTERS = 10_000_000
"""Of a file: far above any configuration; a device, as /dev/zero, has no end."""

MOST_VALUES = 100_000
"""In one file, aliases followed: far above any configuration, far below what fills memory."""


def read_yaml(path: str | os.PathLike[str]) -> Any:
    """Read a YAML 1.2 file of plain values (no tags, no code, no duplicate keys).

    A file that ends in ``.json`` is read as JSON.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    object
        Dicts, lists, strings, numbers, booleans and None.

    Raises
    ------
    InputError
        If the file is missing, unreadable, not text or not YAML; the message names the line.
    """
    try:
        with Path(path).open(encoding="utf-8") as stream:
            text = stream.read(MOST_CHARACTERS + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"{path}: longer than {MOST_CHARACTERS} characters")
    if Path(path).suffix == ".json":
        return _checked(_parse_json(text, str(path)), str(path))
    return _parse(text, str(path))


def parse_value(text: str, where: str) -> Any:
    """Parse one YAML value given as text."""
    return _parse(text, where)


def _parse(text: str, where: str) -> Any:
    try:
        value = YAML(typ="safe", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{where}{line}: not valid YAML ({error.problem})") from None
    except (YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{where}: not valid YAML ({str(error).splitlines()[0]})") from None
    return _checked(value, where)


def _parse_json(text: str, where: str) -> Any:
    """A record that a run wrote: as YAML it would take a hundred times as long."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not valid JSON ({error})") from None


def _checked(value: Any, where: str) -> Any:
    """Plain values, not too many of them."""
    for item in _walk(value, MOST_VALUES):
        if not _has_plain_keys(item):
            raise InputError(f"{where}: not plain YAML (a key is a list, a mapping or a date)")
        if not _is_text(item):
            raise InputError(f"{where}: found {item!a:.60}, which is no text: half of a character")
    if sum(1 for _ in _walk(value, MOST_VALUES)) > MOST_VALUES:
        raise InputError(
            f"{where}: more than {MOST_VALUES} values, or an alias that refers to itself"
        )
    return value


def _walk(value: Any, most: int) -> Iterator[Any]:
    """All values with aliases followed, no further than just above `most` of them."""
    waiting, count = [value], 0
    while waiting and count <= most:
        item = waiting.pop()
        count += 1
        yield item
        if isinstance(item, dict):
            waiting.extend(item.values())
            waiting.extend(key for key in item if isinstance(key, str))
        elif isinstance(item, list | tuple | set):
            waiting.extend(item)


def _has_plain_keys(item: Any) -> bool:
    return not isinstance(item, dict) or all(
        key is None or isinstance(key, str | int | float) for key in item
    )


def _is_text(item: Any) -> bool:
    """Whether text can be written; YAML's escapes can name halves of characters (surrogates)."""
    return (
        not isinstance(item, str)
        or item.isascii()
        or not any("\ud800" <= letter <= "\udfff" for letter in item)
    )


def write_yaml(value: Any, path: str | os.PathLike[str]) -> None:
    """Write plain values as YAML, keys in the order given."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    stream = io.StringIO()
    yaml.dump(value, stream)
    Path(path).write_text(stream.getvalue(), encoding="utf-8")

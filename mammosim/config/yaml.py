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
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)
from ruamel.yaml.parser import Parser

from mammosim.config.files import open_file
from mammosim.errors import InputError

MAX_BYTES = {".json": 10_000_000}
"""Of a file, by its ending: far above any record."""

MAX_YAML_BYTES = 1_000_000
"""Of a YAML file, a hundred times a long configuration: it takes up to 10 s to parse."""

MAX_VALUES = 20_000
"""Keys and values in one YAML file, aliases and merge keys followed: a hundred lesions with all
their keys are 2000, and 20 000 take 3 s to parse."""

MAX_JSON_VALUES = 100_000
"""In one JSON file, which is parsed a hundred times as fast."""

MAX_DEPTH = 50
"""Of lists and mappings in each other; a configuration has 6."""

MAX_BITS = 128
"""Of a whole number, 39 digits: as many as a seed of NumPy's generators is drawn from."""


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
    ending = Path(path).suffix
    text = _text(path, MAX_BYTES.get(ending, MAX_YAML_BYTES))
    if ending == ".json":
        return _checked(_parse_json(text, str(path)), str(path), MAX_JSON_VALUES)
    return _parse(text, str(path))


def _text(path: str | os.PathLike[str], max_bytes: int) -> str:
    try:
        with open_file(path) as stream:
            content = stream.read(max_bytes + 1)
        if len(content) <= max_bytes:
            return content.decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    raise InputError(f"{path}: longer than {max_bytes} bytes")


def parse_value(text: str, where: str) -> Any:
    """Parse one YAML value given as text, as a command gives it after `section.key=`.

    Parameters
    ----------
    text : str
    where : str
        What the value is for; begins the message of an error.

    Returns
    -------
    object
        Plain: mappings, lists, text, numbers, booleans or None.

    Raises
    ------
    InputError
        If the text is not YAML, or more than a configuration may hold.

    Examples
    --------
    >>> parse_value("[CC, MLO]", "views")
    ['CC', 'MLO']
    """
    return _parse(text, where)


class _BoundedParser(Parser):
    """A parser that counts what it has given: ruamel builds everything before anyone can look.

    An alias counts as all that its anchor holds. So does a merge key, which is an alias or a list
    of aliases to the parser: ten of them in each of ten levels would be 10^10 keys.
    """

    def __init__(self, loader: Any) -> None:
        super().__init__(loader=loader)
        self._values = 0
        self._open: list[tuple[str | None, int]] = []
        self._held: dict[str, int] = {}

    def get_event(self) -> Any:
        """The next event, counted."""
        event = super().get_event()
        if isinstance(event, AliasEvent):
            itself = any(anchor == event.anchor for anchor, _ in self._open)
            self._count(MAX_VALUES if itself else self._held.get(event.anchor, 1), event)
        elif isinstance(event, NodeEvent):
            self._count(1, event)
            if isinstance(event, SequenceStartEvent | MappingStartEvent):
                self._open.append((event.anchor, self._values - 1))
                if len(self._open) > MAX_DEPTH:
                    raise _refused(f"nested more than {MAX_DEPTH} deep", event)
            elif event.anchor is not None:
                self._held[event.anchor] = 1
        elif isinstance(event, SequenceEndEvent | MappingEndEvent):
            anchor, before = self._open.pop()
            if anchor is not None:
                self._held[anchor] = self._values - before
        elif isinstance(event, DocumentStartEvent) and event.version == (1, 1):
            # Its numbers to the base 60 take minutes where they are long.
            raise _refused("YAML 1.1, expected 1.2; remove the line %YAML", event)
        return event

    def _count(self, number: int, event: Any) -> None:
        self._values += number
        if self._values > MAX_VALUES:
            what = f"more than {MAX_VALUES} values, or an alias that refers to itself"
            raise _refused(what, event)


class _Refused(Exception):
    """What a file may not hold."""


def _refused(what: str, event: Any) -> _Refused:
    return _Refused(f", line {event.start_mark.line + 1}: {what}")


def _parse(text: str, where: str) -> Any:
    yaml = YAML(typ="safe", pure=True)
    yaml.Parser = _BoundedParser
    try:
        value = yaml.load(text)
    except _Refused as error:
        raise InputError(f"{where}{error}") from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark is not None else ""
        raise InputError(f"{where}{line}: not valid YAML ({error.problem})") from None
    except (YAMLError, ValueError, RecursionError, OverflowError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{where}: not valid YAML ({reason})") from None
    return _checked(value, where, MAX_VALUES)


def _parse_json(text: str, where: str) -> Any:
    """A record that a run wrote: as YAML it would take a hundred times as long."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not valid JSON ({error})") from None


def _checked(value: Any, where: str, max_values: int) -> Any:
    """Plain values, not too many of them, and numbers of a length that can be written."""
    count = 0
    for item in _walk(value, max_values):
        count += 1
        if not _has_plain_keys(item):
            raise InputError(f"{where}: not plain YAML (a key is a list, a mapping or a date)")
        if not _is_text(item):
            raise InputError(
                f"{where}: found {item!a:.60}, which is not valid text: half of a character"
            )
        if isinstance(item, int) and item.bit_length() > MAX_BITS:
            raise InputError(
                f"{where}: found a whole number of {item.bit_length()} bits, expected at most "
                f"{MAX_BITS} (39 digits)"
            )
    if count > max_values:
        raise InputError(
            f"{where}: more than {max_values} values, or an alias that refers to itself"
        )
    return value


def _walk(value: Any, most: int) -> Iterator[Any]:
    """All values and keys with aliases followed, no further than just above `most` of them."""
    waiting, count = [value], 0
    while waiting and count <= most:
        item = waiting.pop()
        count += 1
        yield item
        if isinstance(item, dict):
            waiting.extend(item.values())
            waiting.extend(key for key in item if isinstance(key, str | int))
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
    """Write plain values as YAML in block style, keys in the order given.

    Parameters
    ----------
    value : object
        Mappings, lists, text, numbers, booleans and None; see `as_plain` for settings.
    path : path
        Replaced if it exists. Written in one go, but not atomically.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    stream = io.StringIO()
    yaml.dump(value, stream)
    Path(path).write_text(stream.getvalue(), encoding="utf-8")

"""The form of a configuration: its fields from the JSON Schema, and values from field to file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mammosim.config import parse_value
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, config_of
from mammosim.report import key_in_words

Kind = Literal["switch", "choice", "number", "text", "values"]
"""How a field is edited; `values` are lists and mappings, as YAML."""

KeyPath = tuple[str, ...]

WHERE = "form"
"""Name of the form in messages; it is removed before they are shown."""


@dataclass(frozen=True)
class Field:
    """One field of the form.

    Parameters
    ----------
    path : tuple of str
        Keys from the top of the configuration.
    label : str
        The key in words, with its unit.
    text : str
        The setting's own sentences.
    kind : str
    choices : tuple of str
    default : str
        The default as text; empty where there is none.
    """

    path: KeyPath
    label: str
    text: str
    kind: Kind
    choices: tuple[str, ...] = ()
    default: str = ""

    @property
    def key(self) -> str:
        """The path as messages write it."""
        return ".".join(self.path)


def form_fields() -> tuple[Field, ...]:
    """All fields, in the order of the configuration's sections."""
    schema = RunConfig.model_json_schema()
    return tuple(_fields(schema, (), schema["$defs"], ()))


def _fields(
    node: Mapping[str, Any], path: KeyPath, known: Mapping[str, Any], above: tuple[str, ...]
) -> Iterator[Field]:
    for key, raw in node.get("properties", {}).items():
        here, found, name = (*path, key), *_resolved(raw, known)
        if "properties" in found and name not in above:
            yield from _fields(found, here, known, (*above, name))
        else:
            text = " ".join(str(raw.get("description", "")).split())
            default = "" if raw.get("default") in (None, [], {}) else as_text(raw["default"])
            choices = tuple(str(choice) for choice in found.get("enum", ()))
            kind = _kind(found)
            yield Field(here, key_in_words(".".join(here)), text, kind, choices, default)


def _resolved(node: Mapping[str, Any], known: Mapping[str, Any]) -> tuple[Mapping[str, Any], str]:
    """A node without its reference and without `null`, and the name that it referred to."""
    if "anyOf" in node:
        parts = [part for part in node["anyOf"] if part.get("type") != "null"]
        return _resolved(parts[0], known) if len(parts) == 1 else ({}, "")
    if "$ref" in node:
        name = str(node["$ref"]).rpartition("/")[2]
        return known[name], name
    return node, ""


def _kind(node: Mapping[str, Any]) -> Kind:
    if "enum" in node:
        return "choice"
    kinds: dict[str, Kind] = {
        "boolean": "switch", "number": "number", "integer": "number", "string": "text",
    }  # fmt: skip
    return kinds.get(str(node.get("type")), "values")


def as_text(value: Any) -> str:
    """A value as the form shows it; lists and mappings as YAML in one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list | dict) else str(value)


def texts_of(values: Mapping[str, Any], fields: tuple[Field, ...]) -> dict[str, str]:
    """What the fields hold for a configuration's plain values, by key."""
    found = {}
    for field in fields:
        value: Any = values
        for key in field.path:
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None:
            found[field.key] = as_text(value)
    return found


def values_of(
    texts: Mapping[str, str], fields: tuple[Field, ...], opened: Mapping[str, Any]
) -> dict[str, Any]:
    """Plain values of what the fields hold.

    Parameters
    ----------
    texts : mapping of str to str
        By key; empty where a field is not set.
    fields : tuple of Field
    opened : mapping
        The configuration that was opened: what has no field is kept.

    Raises
    ------
    InputError
        With one line per field that is not valid YAML.
    """
    values: dict[str, Any] = json.loads(json.dumps(opened, default=str))
    problems = []
    for field in fields:
        text = texts.get(field.key, "").strip()
        if not text:
            _remove(values, field.path)
            continue
        try:
            value = text if field.kind in ("text", "choice") else parse_value(text, field.key)
        except InputError as error:
            problems += list(error.problems)
            continue
        _set(values, field.path, value)
    if problems:
        raise InputError(problems)
    return values


def _set(values: dict[str, Any], path: KeyPath, value: Any) -> None:
    for key in path[:-1]:
        inner = values.get(key)
        if not isinstance(inner, dict):
            inner = values[key] = {}
        values = inner
    values[path[-1]] = value


def _remove(values: dict[str, Any], path: KeyPath) -> None:
    for key in path[:-1]:
        inner = values.get(key)
        if not isinstance(inner, dict):
            return
        values = inner
    values.pop(path[-1], None)


def checked(values: dict[str, Any], folder: Path) -> RunConfig:
    """The configuration of plain values; paths in it are relative to the folder."""
    return config_of(values, folder, WHERE)


def by_field(error: InputError, fields: tuple[Field, ...]) -> tuple[dict[str, str], list[str]]:
    """Messages by the key of their field, and those that belong to no field.

    A message names its key, or one inside the field, such as `views.0.view` for `views`.
    """
    placed: dict[str, str] = {}
    others = []
    for line in error.problems:
        said = line.removeprefix(f"{WHERE}: ")
        key, _, message = said.partition(": ")
        matching = [f.key for f in fields if key == f.key or key.startswith(f"{f.key}.")]
        if matching:
            inner = key.removeprefix(matching[0]).lstrip(".")
            placed[matching[0]] = f"{inner}: {message}" if inner else message
        else:
            others.append(said)
    return placed, others

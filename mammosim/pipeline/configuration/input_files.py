"""Files that a configuration names: where, and what remains of it without their place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mammosim.config import user_path
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.pipeline.configuration.view_settings import VIEW_SECTIONS

EACH = "*"
"""In a key path, every item of a list."""

PATH_KEYS = (
    ("phantom", "file"),
    ("phantom", "file", "L"),
    ("phantom", "file", "R"),
    ("phantom", "labels"),
    ("phantom", "lesions", EACH, "file"),
    ("acquisition", "spectrum_file"),
    ("acquisition", "composition"),
)
"""Keys whose value is, or may be, a path relative to the configuration's file."""


def make_paths_absolute(values: dict[str, Any], folder: Path, origin: str) -> None:
    """Replace paths in plain values by absolute ones.

    Parameters
    ----------
    values : dict
        Changed in place.
    folder : Path
        What paths are relative to.
    origin : str
        Where the values stand, for messages.

    Raises
    ------
    InputError
        If a path begins with the home folder of an unknown user.
    """
    for where, value in named_paths(values):
        block = values
        for key in where[:-1]:
            block = block[key]
        at = f"{origin}: {'.'.join(str(key) for key in where)}"
        block[where[-1]] = str(folder / user_path(value, at))


def named_paths(values: dict[str, Any]) -> list[tuple[tuple[Any, ...], str]]:
    """Where a configuration's plain values name files, and the paths: in sections and in views."""
    found: list[tuple[tuple[Any, ...], Any]] = []
    for section, *rest in PATH_KEYS:
        patterns: list[tuple[Any, ...]] = [(section, *rest)]
        if section in VIEW_SECTIONS:
            patterns += [("views", EACH, *rest), ("views", EACH, section, *rest)]
        places = [place for pattern in patterns for place in _expanded(values, pattern)]
        found += [(place, _inside(values, place)) for place in places]
    return [
        (where, value)
        for where, value in found
        if isinstance(value, str)
        and (any(str(key).endswith("file") for key in where) or Path(value).suffix)
    ]


def input_paths(config: RunConfig) -> list[tuple[tuple[Any, ...], str]]:
    """Key paths at which a configuration names files, and the absolute paths."""
    named = named_paths(config.plain())
    return [(where, value) for where, value in named if Path(value).is_absolute()]


def without_paths(config: RunConfig) -> dict[str, Any]:
    """The configuration's values, without where its input files lie."""
    values = config.plain()
    for where, value in input_paths(config):
        block = values
        for key in where[:-1]:
            block = block[key]
        block[where[-1]] = Path(value).name
    return values


def _expanded(values: dict[str, Any], pattern: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """Key paths that match a pattern, for the lists that exist."""
    if EACH not in pattern:
        return [pattern]
    at = pattern.index(EACH)
    items = _inside(values, pattern[:at])
    count = len(items) if isinstance(items, list) else 0
    paths = [(*pattern[:at], number, *pattern[at + 1 :]) for number in range(count)]
    return [path for one in paths for path in _expanded(values, one)]


def _inside(values: Any, where: tuple[Any, ...]) -> Any:
    """What stands at a key path; None where nothing does."""
    for key in where:
        if isinstance(key, int):
            values = values[key] if isinstance(values, list) else None
        else:
            values = values.get(key) if isinstance(values, dict) else None
    return values

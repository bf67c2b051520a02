"""From a file to a checked configuration, with single values changed on the way."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mammosim.config import (
    as_plain,
    given_settings,
    parse_value,
    read_yaml,
    real_path,
    to_settings,
)
from mammosim.errors import InputError
from mammosim.pipeline.configuration.input_files import make_paths_absolute
from mammosim.pipeline.configuration.run_config import RunConfig


def load_config(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> RunConfig:
    """Read and check a configuration.

    Parameters
    ----------
    path : path
        A YAML file, or a run's `run.json`; paths in it are relative to it.
    changes : sequence of str
        ``section.key=value`` each, in place of what the file says; paths in them are relative to
        the current folder.

    Returns
    -------
    RunConfig

    Raises
    ------
    InputError
        With one line a mistake: file, key path, value found, what is allowed.
    """
    values = _run_settings(read_yaml(path), path)
    make_paths_absolute(values, real_path(path).parent, str(path))
    for change in changes:
        apply_change(values, change)
    return config_of(values, Path.cwd(), str(path))


def given_config(config: RunConfig | None, sections: Mapping[str, Any], where: str) -> RunConfig:
    """The configuration that a function was given, as an object or as keywords.

    Parameters
    ----------
    config : RunConfig or None
    sections : mapping of str to object
        Sections and keys of `RunConfig`; paths in them are relative to the current folder.
    where : str
        Name of the function, for messages.

    Raises
    ------
    InputError
        With one line a mistake, or if both or neither are given.
    """
    if config is None:
        return config_of(as_plain(sections), Path.cwd(), where)
    return given_settings(RunConfig, config, sections, where)


def config_of(values: dict[str, Any], folder: Path, where: str) -> RunConfig:
    """Check plain values and make a configuration of them.

    Parameters
    ----------
    values : dict
        Plain values as YAML gives them; paths in them are made absolute in place.
    folder : Path
        What paths are relative to.
    where : str
        Where the values stand, for messages.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    make_paths_absolute(values, folder, where)
    try:
        return to_settings(RunConfig, values, where)
    except InputError as error:
        raise InputError(
            line if line.startswith(where) else f"{where}: {line}" for line in error.problems
        ) from None


def is_cohort(values: Any) -> bool:
    """Whether a file's plain values are a cohort's, not a run's configuration.

    Parameters
    ----------
    values : object
        As read from YAML.

    Examples
    --------
    >>> is_cohort({"cohort": {"patients": 20}}), is_cohort({"views": ["CC"]})
    (True, False)
    """
    return isinstance(values, dict) and not values.keys().isdisjoint(("cohort", "cohort_of"))


def _run_settings(values: Any, path: str | os.PathLike[str]) -> dict[str, Any]:
    """The configuration, also where it stands in a run's record."""
    if isinstance(values, dict) and {"run_hash", "settings"} <= values.keys():
        values = values["settings"]
    if is_cohort(values):
        raise InputError(f"{path}: is a cohort's file; use mammosim cohort run")
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected a mapping with the section 'phantom'")
    return values


def apply_change(values: dict[str, Any], change: str) -> None:
    """Put one value, given as `section.key=value`, in place of what plain values say.

    Parameters
    ----------
    values : dict
        Plain values of a configuration; changed in place. Sections that are missing are made.
    change : str
        ``section.key=value``, the value in YAML; ``list.0.key`` is an item's.

    Raises
    ------
    InputError
        If it has not this form, or leads through something that has no keys.

    Examples
    --------
    >>> values = {"phantom": {"lesions": [{"diameter_mm": 6}]}}
    >>> apply_change(values, "phantom.lesions.0.diameter_mm=12")
    >>> apply_change(values, "compression.thickness_mm=50")
    >>> values
    {'phantom': {'lesions': [{'diameter_mm': 12}]}, 'compression': {'thickness_mm': 50}}
    """
    name, equals, text = change.partition("=")
    keys = name.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"found '{change}', expected section.key=value")
    block: Any = values
    for number, key in enumerate(keys[:-1]):
        place = _place_in(block, key, keys[:number], name)
        if isinstance(block, dict) and block.get(key) is None:
            block[key] = {}
        block = block[place]
    block[_place_in(block, keys[-1], keys[:-1], name)] = parse_value(text, name)


def _place_in(block: Any, key: str, above: Sequence[str], name: str) -> str | int:
    """Where a part of a key path lies in a mapping or a list."""
    if isinstance(block, dict):
        return key
    where = ".".join(above)
    if not isinstance(block, list):
        raise InputError(
            f"'{name}': {where} is {block!r:.60}, no section or list; set {where} itself"
        )
    if not (key.isascii() and key.isdigit() and int(key[:9]) < len(block)):
        items = f"0 to {len(block) - 1}" if block else "none yet"
        raise InputError(
            f"'{name}': found '{key}' in the list {where}, expected the number of an item, "
            f"{items}; or set the whole list, as {where}=[...]"
        )
    return int(key)

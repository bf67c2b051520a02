"""Plain values against settings: every mistake in one error, in words."""

from __future__ import annotations

import difflib
import json
from typing import Any, TypeVar

from pydantic import ValidationError

from mammosim.config.settings import Settings
from mammosim.errors import InputError

SettingsType = TypeVar("SettingsType", bound=Settings)


def to_settings(
    kind: type[SettingsType], values: Any, where: str, prefix: tuple[str, ...] = ()
) -> SettingsType:
    """Check plain values and make settings of them.

    Parameters
    ----------
    kind : type of Settings
        What to make.
    values : object
        Plain values as YAML gives them.
    where : str
        Name of the file (or other origin), for messages.
    prefix : tuple of str
        Key path of `values` in that file.

    Raises
    ------
    InputError
        One line a mistake: file, key path, value found, what is allowed, and for an unknown key
        the nearest known one.
    """
    if values is None:
        values = {}
    if not isinstance(values, dict):
        at = ".".join(prefix) or "top level"
        raise InputError(f"{where}: {at}: found {_shown(values)}, expected a mapping of keys")
    try:
        # JSON mode is strict about types (no "5" for 5, no true for 1) yet takes lists for tuples.
        text = _as_json(values)
    except (ValueError, TypeError, RecursionError) as error:
        at = ".".join(prefix) or "top level"
        raise InputError(f"{where}: {at}: cannot be written as JSON ({error})") from None
    try:
        return kind.model_validate_json(text, strict=True)
    except ValidationError as error:
        items = error.errors()
        problems = [
            _sentence(kind, item, where, prefix)
            for item in items
            if not _is_short_of_faulty_ones(item, items)
        ]
        raise InputError(dict.fromkeys(problems)) from None


def _is_short_of_faulty_ones(item: Any, items: list[Any]) -> bool:
    """Pydantic calls a list too short whose entries are faulty: those are told already."""
    depth = len(item["loc"])
    return item["type"] == "too_short" and any(
        len(other["loc"]) > depth and other["loc"][:depth] == item["loc"] for other in items
    )


def as_plain(value: Any) -> Any:
    """A copy of nested values as YAML and JSON hold them.

    Parameters
    ----------
    value : object
        Settings, mappings, sequences, numbers, text, booleans or None, nested.

    Returns
    -------
    object
        Settings as mappings of all their fields, tuples as lists; nothing is shared with `value`.

    Examples
    --------
    >>> as_plain({"views": ("CC", "MLO"), "seed": 1})
    {'views': ['CC', 'MLO'], 'seed': 1}
    """
    return json.loads(_as_json(value))


def _as_json(value: Any) -> str:
    return json.dumps(value, default=_as_plain, allow_nan=True)


def _as_plain(value: Any) -> Any:
    """Settings, NumPy numbers and arrays, paths and dates as JSON has them."""
    if isinstance(value, Settings):
        return value.model_dump(mode="json", exclude_unset=True)
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _sentence(kind: type[Settings], item: Any, where: str, prefix: tuple[str, ...]) -> str:
    # An unknown key is the user's own, whatever it looks like.
    own = len(item["loc"]) - 1 if item["type"] == "extra_forbidden" else len(item["loc"])
    location = tuple(
        str(part) for place, part in enumerate(item["loc"])
        if place >= own or not _is_union_tag(part)
    )  # fmt: skip
    path = ".".join((*prefix, *location)) or "top level"
    if item["type"] == "extra_forbidden":
        known = _known_keys(kind, item["loc"][:-1])
        near = difflib.get_close_matches(location[-1], known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(sorted(known))}"
        return f"{where}: {path}: unknown key; {hint}"
    if item["type"] == "missing":
        return f"{where}: {path}: missing; it must be given"
    if item["type"] == "too_short":
        least = item["ctx"]["min_length"]
        return f"{where}: {path}: found {_shown(item['input'])}, expected at least {least} of them"
    if item["type"] == "too_long":
        most, count = item["ctx"]["max_length"], item["ctx"].get("actual_length")
        found = count if isinstance(count, int) else f"more than {most}"
        return f"{where}: {path}: found {found} entries, expected at most {most}"
    if item["type"] in ("list_type", "tuple_type"):
        hint = f", as [{item['input']}]" if isinstance(item["input"], str | int | float) else ""
        return f"{where}: {path}: found {_shown(item['input'])}, expected a list{hint:.60}"
    if item["type"] in ("model_type", "dict_type"):
        return f"{where}: {path}: found {_shown(item['input'])}, expected a mapping of keys"
    reason = item["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    verb = "" if item["msg"].startswith("Value error, ") else "expected "
    return f"{where}: {path}: found {_shown(item['input'])}, {verb}{reason}"


def _is_union_tag(part: Any) -> bool:
    """Pydantic puts the name of the tried alternative of a union into the path."""
    return isinstance(part, str) and (
        part[:1].isupper()
        or part.startswith(("literal[", "list[", "tuple[", "function-", "dict[", "constrained-"))
        or part in {"float", "int", "str", "bool", "none"}
    )


def _known_keys(kind: Any, location: tuple[Any, ...]) -> list[str]:
    """Names allowed at a key path, found by walking the fields of the settings."""
    for part in location:
        if not (isinstance(kind, type) and issubclass(kind, Settings)):
            return []
        if isinstance(part, str) and part in kind.model_fields:
            kind = settings_in(kind.model_fields[part].annotation)
    return list(kind.model_fields) if isinstance(kind, type) and issubclass(kind, Settings) else []


def settings_in(annotation: Any) -> type[Settings] | None:
    """The settings that a field's annotation holds, alone or among others.

    Parameters
    ----------
    annotation : object
        Of a field, as `PaddleSettings | None` or `tuple[ViewSettings, ...]`.

    Returns
    -------
    type of Settings or None
        The first one found; None if the annotation has none.

    Examples
    --------
    >>> class Paddle(Settings):
    ...     pass
    >>> settings_in(tuple[Paddle, ...] | None).__name__
    'Paddle'
    >>> settings_in(float | None) is None
    True
    """
    if isinstance(annotation, type) and issubclass(annotation, Settings):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        found = settings_in(argument)
        if found is not None:
            return found
    return None


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."

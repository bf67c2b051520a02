"""Records as arrays and plain values, and back bit by bit: what a kept stage's file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast


def _records_in(kind: Any, found: dict[str, type[Any]]) -> dict[str, type[Any]]:
    """The dataclasses that a type's fields may hold, itself among them."""
    if isinstance(kind, type) and is_dataclass(kind) and kind.__name__ not in found:
        found[kind.__name__] = kind
        for hint in get_type_hints(kind).values():
            _records_in(hint, found)
    for argument in get_args(kind):
        _records_in(argument, found)
    return found


RECORDS: dict[str, type[Any]] = _records_in(CompressedBreast, {})
"""What may be made again from a file: nothing but these, and plain values."""

_PLAIN = (bool, int, float, str)


def pack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Split a record into plain values and arrays.

    Parameters
    ----------
    value : object
        A record of `RECORDS`, an array, a number, text, None, or a mapping or sequence of these.
    arrays : dict of str to ndarray
        Arrays are added here, under names that the plain values refer to.

    Returns
    -------
    object
        Plain values as JSON holds them.

    Raises
    ------
    TypeError
        For anything else: a field that has been added to a record and is none of these.
    """
    if value is None or type(value) in _PLAIN:
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        name = f"a{len(arrays)}"
        arrays[name] = np.asarray(value)
        return {"number" if isinstance(value, np.generic) else "array": name}
    if is_dataclass(value) and type(value).__name__ in RECORDS:
        packed = {part.name: pack(getattr(value, part.name), arrays) for part in fields(value)}
        return {"record": type(value).__name__, "fields": packed}
    if isinstance(value, Mapping):
        return {"pairs": [[pack(key, arrays), pack(item, arrays)] for key, item in value.items()]}
    if isinstance(value, (tuple, list)):
        return {type(value).__name__: [pack(item, arrays) for item in value]}
    raise TypeError(f"a stage's result holds a {type(value).__name__}, which cannot be kept")


def unpack(packed: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """Make again what `pack` has split.

    Raises
    ------
    KeyError, TypeError, ValueError
        If it is not what `pack` makes.
    """
    if not isinstance(packed, dict):
        return packed
    if "record" in packed:
        kind = RECORDS[packed["record"]]
        return kind(**{name: unpack(part, arrays) for name, part in packed["fields"].items()})
    (form, content), *_ = packed.items()
    if form == "array":
        return arrays[content]
    if form == "number":
        return arrays[content][()]
    if form == "pairs":
        return {unpack(key, arrays): unpack(item, arrays) for key, item in content}
    items = [unpack(item, arrays) for item in content]
    return {"tuple": tuple, "list": list}[form](items)

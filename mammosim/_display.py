"""How results show, draw and save themselves.

The functions that do so lie in higher rooms than the results. A result's methods look them up here,
by its class and what is asked for; `mammosim/__init__.py` holds the table. Nothing is imported
before it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

_homes: dict[str, str] = {}


def register_displays(homes: Mapping[str, str]) -> None:
    """Say where functions are: `Class.method` to `module:function`."""
    _homes.update(homes)


def display_of(record: object, method: str) -> Callable[..., Any]:
    """The function that a method of a result calls with the result."""
    module, _, name = _homes[f"{type(record).__name__}.{method}"].partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function

"""Loading the program's modules, which takes most of the time until a command begins."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def loading() -> Iterator[None]:
    """Load modules without a search for garbage, and leave them out of later searches.

    Python looks through all objects again and again while their number grows, and what modules
    hold is never garbage: that takes a seventh of the time.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

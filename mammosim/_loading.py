"""Loading the program's modules, which takes most of the time until a command or worker begins."""

from __future__ import annotations

import gc
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def loading() -> Iterator[None]:
    """Load modules with garbage collection off, and leave them out of later collections.

    While the number of objects grows, Python goes through all of them again and again, which takes
    a seventh of the time; what modules hold is never garbage.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

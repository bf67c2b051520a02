"""What was made last of an object, kept for those that ask for it again."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Generic, TypeVar
from weakref import ref

Source = TypeVar("Source")
Made = TypeVar("Made")


class Latest(Generic[Source, Made]):
    """Keeps what was made of the object asked for last, as long as that object exists.

    Threads may share it: the second to ask waits for the first.
    """

    def __init__(self) -> None:
        self._kept: tuple[ref[Source], Made] | None = None
        self._making = Lock()

    def of(self, source: Source, make: Callable[[], Made]) -> Made:
        """What is kept of the object, or is made of it now."""
        with self._making:
            kept = self._kept
            if kept is None or kept[0]() is not source:
                kept = ref(source, self._forget), make()
                self._kept = kept
            return kept[1]

    def _forget(self, gone: ref[Source]) -> None:
        if self._kept is not None and self._kept[0] is gone:
            self._kept = None

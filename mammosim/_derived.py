"""What was made of an object, kept in case it is asked for again."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

Source = TypeVar("Source")
Made = TypeVar("Made")


class Derived(Generic[Source, Made]):
    """Keeps what was made of each object, as long as the object exists.

    Threads may share it: one that asks for what another is making waits for it.
    """

    def __init__(self) -> None:
        self._places: WeakKeyDictionary[Source, _Place[Made]] = WeakKeyDictionary()
        self._finding = Lock()

    def of(self, source: Source, make: Callable[[], Made]) -> Made:
        """What is kept of the object, or is made of it now."""
        with self._finding:
            place = self._places.setdefault(source, _Place())
        with place.making:
            if not place.made:
                place.made.append(make())
        return place.made[0]


class _Place(Generic[Made]):
    """Holds one such thing once it is made."""

    def __init__(self) -> None:
        self.making, self.made = Lock(), list[Made]()

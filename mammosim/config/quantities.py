"""Kinds of numbers and names that sections share, with the bounds that hold everywhere."""

from __future__ import annotations

import unicodedata
from typing import Annotated

from pydantic import AfterValidator, Field

MAX_COORDINATE_MM = 1e4
"""Of a position: no scanner or phantom has axes of more than 10 m."""

MAX_LENGTH_MM = 1e3
"""Of a plate, a detector, or a gap between them."""

MAX_FORCE_N = 2e3
"""Of a paddle: ten times the most that screening units press with (assumed)."""

UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode's categories of control and formatting characters, surrogates and line ends."""


def _visible(name: str) -> str:
    odd = [letter for letter in name if unicodedata.category(letter) in UNSEEN]
    if odd:
        raise ValueError(
            f"holds the control character U+{ord(odd[0]):04X}, expected text that can be printed"
        )
    if not name.strip():
        raise ValueError("expected a name, not blanks alone")
    return name


Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_MM, le=MAX_COORDINATE_MM)]
"""A position along an axis, mm."""

Position = tuple[Coordinate, Coordinate, Coordinate]
"""A point, mm."""

Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_visible)]
"""A name for people: up to 64 characters, as DICOM's long strings (PS3.5, 6.2, LO), all of which
can be printed."""

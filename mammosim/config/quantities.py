"""Kinds of numbers and names that sections share, with the bounds that hold everywhere."""

from __future__ import annotations

import unicodedata
from pathlib import PurePath
from typing import Annotated

from pydantic import AfterValidator, Field

MAX_COORDINATE_MM = 1e4
"""Of a position: no scanner or phantom has axes of more than 10 m."""

MAX_LENGTH_MM = 1e3
"""Of a plate, a detector, or a gap between them."""

MAX_FORCE_N = 2e3
"""Of a paddle: ten times the most that screening units press with (assumed)."""

MAX_FOLDER_NAME = 255
"""Bytes of a folder's name, as Linux, macOS and Windows allow."""

UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode's categories of control and formatting characters, surrogates and line ends."""


def _visible(name: str) -> str:
    odd = [letter for letter in name if unicodedata.category(letter) in UNSEEN]
    if odd:
        raise ValueError(
            f"holds the control character U+{ord(odd[0]):04X}, expected text that can be printed"
        )
    if not name.strip():
        raise ValueError("expected a name, not only blanks")
    return name


def folder_name(given: object, otherwise: str) -> str:
    """A title that a record gives, if it can be the name of a folder as it is; else another one.

    A record may come from anywhere, and must not say where files are written.

    Parameters
    ----------
    given : object
        What the record holds.
    otherwise : str

    Examples
    --------
    >>> folder_name("mine", "run"), folder_name("../mine", "run"), folder_name("/tmp", "run")
    ('mine', 'run', 'run')
    """
    if not isinstance(given, str) or given in ("", ".", "..") or PurePath(given).name != given:
        return otherwise
    if "\\" in given or any(unicodedata.category(letter) in UNSEEN for letter in given):
        return otherwise
    return given if len(given.encode()) <= MAX_FOLDER_NAME else otherwise


Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_MM, le=MAX_COORDINATE_MM)]
"""A position along an axis, mm."""

Position = tuple[Coordinate, Coordinate, Coordinate]
"""A point, mm."""

Name = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(_visible)]
"""A name for people: up to 64 characters, as DICOM's long strings (PS3.5, 6.2, LO), all of which
can be printed."""

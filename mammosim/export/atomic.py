"""Files that are written whole or not at all.

A file is written under a temporary name in its own folder and renamed when it is complete, so
that neither a crash nor a full disk leaves half a file under the name that others read.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mammosim.errors import InputError

PART_PREFIX = ".part-"
"""How the name of a file that is not complete yet begins; its suffix stays as it is."""


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path to write to, and rename it to `path` at the end.

    Parameters
    ----------
    path : path
        Where the file is to be. Its folder is made if it does not exist.

    Yields
    ------
    Path
        A path in the same folder with the same suffix; whatever is there after the block becomes
        `path`. After an exception it is removed and `path` stays as it was.

    Raises
    ------
    InputError
        If the operating system refuses (disk full, read-only folder); names path and reason.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_file(folder + "/note.txt") as part:
    ...         _ = part.write_text("complete")
    ...     Path(folder, "note.txt").read_text()
    'complete'
    """
    path = Path(path)
    part = path.with_name(PART_PREFIX + path.name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({_reason(error)})") from error
    finally:
        _remove(part)


def _reason(error: OSError) -> str:
    """The operating system's own words, also where a library has wrapped them in its own."""
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, OSError) and link.strerror:
            return link.strerror
        link = link.__cause__ or link.__context__
    return str(error).splitlines()[0]


def _remove(part: Path) -> None:
    try:
        part.unlink(missing_ok=True)
    except OSError:
        return  # the folder itself cannot be written; the reason is already on its way up


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file, whole or not at all.

    Parameters
    ----------
    path : path
        Replaced if it exists.
    text : str
        Written in UTF-8 with the line ends that it has.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(text.encode("utf-8"))


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Write plain values as JSON, whole or not at all.

    Parameters
    ----------
    path : path
        Replaced if it exists.
    value : object
        Mappings, sequences, text, numbers, arrays and None. Numbers that are not finite become
        null, which JSON has no other word for.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    text = json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def _plain(value: Any) -> Any:
    """Replace NumPy scalars, tuples and numbers that JSON does not have."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

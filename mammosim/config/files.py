"""Files that a user names: opened only if they are files, and read no further than a limit."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

from mammosim.errors import InputError

KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe (FIFO)",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
"""What may lie at a path in place of a file, in words."""

FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""For reading; a pipe that took the file's place meanwhile does not wait for a writer."""

MAX_RECORD_BYTES = 20_000_000
"""Of a JSON record that a run or a cohort wrote: far above any; `/dev/zero` has no end."""


def open_file(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading, in binary.

    Parameters
    ----------
    path : path

    Raises
    ------
    OSError
        If there is no such file, it cannot be read, or it is a folder, pipe, device or socket.

    Notes
    -----
    Opening a pipe waits for a writer, and reading a device may never end, so neither is opened.
    """
    try:
        refuse_other_kinds(path, os.stat(path).st_mode)
        handle = os.open(path, FLAGS)
    except ValueError as error:  # a NUL in the name
        raise OSError(errno.EINVAL, str(error), str(path)) from None
    stream = os.fdopen(handle, "rb")
    try:
        refuse_other_kinds(path, os.fstat(handle).st_mode)
    except OSError:
        stream.close()
        raise
    return stream


def refuse_other_kinds(path: str | os.PathLike[str], mode: int) -> None:
    """Refuse what is no regular file, by its mode.

    Raises
    ------
    OSError
        Whose `strerror` says what it is.
    """
    if not stat.S_ISREG(mode):
        kind = KINDS.get(stat.S_IFMT(mode), "not a regular file")
        raise OSError(errno.EINVAL, f"it is {kind}, expected a file", str(path))


def read_text(path: str | os.PathLike[str], max_bytes: int = MAX_RECORD_BYTES) -> str:
    """Text of a file in UTF-8.

    Parameters
    ----------
    path : path
    max_bytes : int
        Greatest length allowed.

    Raises
    ------
    OSError
        As `open_file`, and if the file is longer than allowed.
    UnicodeDecodeError
        If it is not UTF-8.
    """
    with open_file(path) as stream:
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"it is longer than {max_bytes} bytes", str(path))
    return content.decode("utf-8")


def user_path(text: str, where: str) -> Path:
    """A path as a user writes it, with ``~`` and ``~name`` replaced by home folders.

    Parameters
    ----------
    text : str
    where : str
        File and key, for messages.

    Raises
    ------
    InputError
        If there is no such user, or the home folder is not known.

    Examples
    --------
    >>> user_path("data/breast.nrrd", "run.yaml: phantom.file").as_posix()
    'data/breast.nrrd'
    """
    try:
        return Path(text).expanduser()
    except RuntimeError:
        user = Path(text).parts[0]
        raise InputError(
            f"{where}: found {text!r:.200}, but the home folder of '{user}' is not known; "
            "write the path without ~"
        ) from None


def real_path(path: str | os.PathLike[str]) -> Path:
    """Where a path leads once all links are followed; links in a circle stay as they are.

    `Path.resolve` raises `RuntimeError` for such links before Python 3.13.

    Parameters
    ----------
    path : path
        It need not exist.
    """
    return Path(os.path.realpath(path))


def utf8_path(path: str | os.PathLike[str]) -> str:
    """A path for a library that takes names in UTF-8, whatever the locale's encoding is.

    Raises
    ------
    InputError
        If the name is not UTF-8.

    Examples
    --------
    >>> utf8_path("breast.nrrd")
    'breast.nrrd'
    """
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeError:
        raise InputError(
            f"{os.fspath(path)!a}: the name of this file or of a folder above it is not UTF-8; "
            "rename it"
        ) from None

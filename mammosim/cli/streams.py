"""Standard output and error that may be closed, full, gone, or unable to show a letter."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any, TextIO

GONE = (errno.EPIPE, errno.ESHUTDOWN)
"""Errors of a reader that has read enough, as `head` does."""


class WatchedStream:
    """A text stream that notes the first failure to write, and is silent from then on.

    Parameters
    ----------
    stream : text stream or None
        None where the process was started with it closed.

    Attributes
    ----------
    failed : OSError or None
        Why something could not be written.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self.failed: OSError | None = None
        if stream is None:
            self.failed = OSError(errno.EBADF, os.strerror(errno.EBADF))
            stream = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a letter that the locale lacks
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text, or nothing once that has failed."""
        if self.failed is None:
            try:
                self._stream.write(text)
            except OSError as error:
                self._fail(error)
        return len(text)

    def flush(self) -> None:
        """Flush what was written."""
        if self.failed is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self.failed = error
        # What is still in the buffer would fail again when the interpreter ends.
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, self._stream.fileno())
        os.close(sink)

    @property
    def is_gone(self) -> bool:
        """Whether the reader has gone, which is not an error."""
        return self.failed is not None and self.failed.errno in GONE

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def hold_standard_streams() -> None:
    """Open what is closed of the standard streams, so that no data file gets their number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number, which is this one


def in_utf8_mode() -> bool:
    """Whether names of files and text are UTF-8, whatever the locale says."""
    return sys.flags.utf8_mode == 1 or sys.getfilesystemencoding().lower() in ("utf-8", "utf8")


def restart_in_utf8_mode() -> None:
    """Start this command again in Python's UTF-8 mode (PEP 540), in the same process.

    Libraries in C++ take names of files in UTF-8 only; a locale without it ends them by an abort.
    """
    os.environ["PYTHONUTF8"] = "1"
    os.execv(sys.executable, [sys.executable, "-X", "utf8", *sys.orig_argv[1:]])

"""One writer for a folder: a lock that the system takes away with the process that holds it."""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from mammosim.errors import InputError

try:
    import fcntl
except ImportError:  # not a Unix: there, two runs on one folder are not detected
    fcntl = None  # type: ignore[assignment]

STAGES_FOLDER = ".stages"
"""Of stages that are kept, in a run's folder; it may be deleted at any time, and costs only time
then."""

LOCK_NAME = ".lock"
"""Of the file in the folder that is locked; it holds the writer's host and process."""

_POLL_S = 0.2
"""Interval at which a folder that is held is tried again, s."""


@contextmanager
def writing(folder: Path, wait_s: float = 0.0) -> Iterator[None]:
    """Hold a folder for one writer, and make it if it does not exist.

    Parameters
    ----------
    folder : path
    wait_s : float
        How long to wait for another writer to end, s.

    Raises
    ------
    InputError
        If another process is writing there, or the folder cannot be written.

    Notes
    -----
    A folder that was made for the writer is removed again if nothing was written.

    The lock is `flock`'s: it ends with its process, however that ends, so that nothing stale is
    ever left. On a network file system it holds between machines where that file system says so
    (NFS from version 4 on, Lustre mounted with ``flock``).
    """
    path = folder / LOCK_NAME
    fresh = not folder.is_dir() or not any(folder.iterdir())
    new = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = _locked(path, time.monotonic() + wait_s)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    if handle is None:
        raise InputError(f"{folder}: is in use by another run{_owner(path)}; wait until it ends")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(handle)
        if fresh:
            _remove_traces(folder, new)


def _remove_traces(folder: Path, new: Sequence[Path]) -> None:
    """Remove a folder, and parents made for it, in which a run left nothing but a kept stage.

    A run that is refused before it begins leaves nothing behind.
    """
    with contextlib.suppress(OSError):
        if {path.name for path in folder.iterdir()} == {STAGES_FOLDER}:
            shutil.rmtree(folder / STAGES_FOLDER)
        for path in new:
            path.rmdir()


def is_being_written(folder: Path) -> bool:
    """Whether another process holds the folder.

    Parameters
    ----------
    folder : Path
        Folder of a run or cohort.

    Returns
    -------
    bool
        False also where there is no folder, or no lock that this user may open.
    """
    try:
        handle = os.open(folder / LOCK_NAME, os.O_RDWR)
    except OSError:
        return False
    try:
        return not _take(handle)
    finally:
        os.close(handle)


def _locked(path: Path, until: float) -> int | None:
    """Handle of the locked file; None where another process keeps it."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        if _take(handle):
            if _is_still(path, handle):
                with contextlib.suppress(OSError):  # on a full disk the lock holds, unsigned
                    os.ftruncate(handle, 0)
                    os.write(handle, f"process {os.getpid()} on {platform.node()}".encode())
                return handle
            os.close(handle)  # its last owner removed it meanwhile: take the new one
            continue
        os.close(handle)
        if time.monotonic() >= until:
            return None
        time.sleep(_POLL_S)


def _take(handle: int) -> bool:
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_still(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except FileNotFoundError:
        return False


def _owner(path: Path) -> str:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")[:100]
    except OSError:
        return ""
    return f" ({text})" if text.isprintable() and text else ""

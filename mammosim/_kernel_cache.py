"""Compiled kernels on the disk: which still hold, where they lie, several processes at once.

A kernel that is kept holds the code of all kernels that it calls. Numba asks only whether the
kernel's own file has changed; here it is whether that file or any of the package's that it imports
has, so that after an update no old formula goes on living inside a kernel of another file. Files
are compared by content: copies, containers and checkouts keep what was compiled, whatever their
files' times.

Kernels are kept where Numba keeps them: in ``NUMBA_CACHE_DIR``, else beside the source, else in the
home folder. What lies in the first two is read also where it cannot be written, as in the image of
a container, and what is missing there is kept in the next of these places.
"""

from __future__ import annotations

import hashlib
import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, ClassVar

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile, _CacheLocator

try:
    import fcntl
except ImportError:  # not a Unix: there, processes that save at the same time compile once more
    fcntl = None  # type: ignore[assignment]

PACKAGE = __name__.partition(".")[0]

LOCK_NAME = "mammosim.lock"

LOCK_S = 5.0
"""How long a process waits for another that reads or writes a kernel, s; that takes milliseconds,
unless the other was suspended in it."""

_IMPORTED = re.compile(rf"^(?:from|import) {PACKAGE}\.([\w.]+)", re.MULTILINE)
_FAMILY = re.compile(r"^@chosen_by_type$", re.MULTILINE)

_DAMAGED = (
    EOFError, ValueError, TypeError, LookupError, AttributeError, ImportError, UnpicklingError,
)  # fmt: skip
"""What reading a damaged file of the cache may raise."""

BUSY = threading.Lock()
"""Held while this process reads or writes a kernel's files; who ends the process takes it first."""

_problems: list[str] = []


def cache_problem() -> str:
    """Why compiled kernels could not be read from, or saved on, the disk; empty if all were."""
    return _problems[0] if _problems else ""


def can_be_kept() -> bool:
    """Whether kernels that are compiled here will be found at the next start."""
    return not _problems and not numba.config.DISABLE_JIT and not _ReadOnlyPlace.in_use


def kernel_cache(function: Any, is_part: bool = False) -> FunctionCache | None:
    """Where a kernel, or the `part` of it that kernels call, is kept; None if nowhere."""
    try:
        return _Cache(function, is_part)
    except RuntimeError:
        _problems.append(
            "cannot be saved: neither the program's folder nor the home folder can be written"
        )
        return None


class _ReadOnlyPlace(_CacheLocator):
    """Where kernels are read from when there is no place to keep any."""

    in_use: ClassVar = False

    def __init__(self, folder: str, line: int) -> None:
        self._folder, self._line = folder, line
        type(self).in_use = True

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _ReadOnlyPlace | None:
        folders = _read_only_folders(py_file)
        return cls(folders[0], py_func.__code__.co_firstlineno) if folders else None

    def get_cache_path(self) -> str:
        return self._folder

    def get_disambiguator(self) -> str:
        return str(self._line)  # as Numba names the files of every kernel in a file

    def get_source_stamp(self) -> str:
        return ""  # not used: see `source_stamp`


class _Places(FunctionCache._impl_class):
    _locator_classes: ClassVar = [*FunctionCache._impl_class._locator_classes, _ReadOnlyPlace]


class _Cache(FunctionCache):
    """Numba's cache on disk, which may fail: the kernel is then compiled again at the next start.

    A full disk, a quota or a folder that cannot be written would otherwise end a run, and a file
    cut short every later one.
    """

    _impl_class = _Places

    def __init__(self, function: Any, is_part: bool) -> None:
        super().__init__(function)
        stamp = source_stamp(Path(function.__code__.co_filename))
        name = self._impl.filename_base + (".part" if is_part else "")
        self._cache_file = _CacheFile(self._cache_path, name, stamp)
        others = _read_only_folders(function.__code__.co_filename)
        self._read_only = [
            _CacheFile(folder, name, stamp) for folder in others if folder != self._cache_path
        ]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        with self._may_fail("read"):
            kept = super().load_overload(sig, target_context)
            if kept is not None or not self._read_only:
                return kept
        key = self._index_key(sig, target_context.codegen())
        for file in self._read_only:
            with suppress(OSError, *_DAMAGED):
                data = file.load(key)
                if data is not None:
                    return self._impl.rebuild(target_context, data)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with self._may_fail("saved"):
            super().save_overload(sig, data)

    @contextmanager
    def _may_fail(self, what: str) -> Iterator[None]:
        """Note a disk that fails; empty a damaged cache, so that it is written again."""
        try:
            yield
        except OSError as error:
            _problems.append(f"cannot be {what}: {error.strerror}")
        except _DAMAGED:
            with suppress(OSError):
                self.flush()


class _CacheFile(IndexDataCacheFile):
    """The files of one kernel, read and written by one process at a time."""

    def load(self, key: Any) -> Any:
        with BUSY, _locked(self._cache_path):
            return super().load(key)

    def save(self, key: Any, data: Any) -> None:
        """Write the machine code, then the index that names it.

        The other way round, a process that is ended in between leaves an index that names the code
        of an earlier version.
        """
        with BUSY, _locked(self._cache_path):
            names = self._load_index()
            if key not in names:
                numbers = range(1, len(names) + 2)
                names[key] = next(
                    name for name in map(self._data_name, numbers) if name not in names.values()
                )
            self._save_data(names[key], data)
            self._save_index(names)


@contextmanager
def _locked(folder: str) -> Iterator[None]:
    """Keep other processes out of a folder of kernels.

    Two that add to the index of one kernel at the same time may give two variants one name. Where
    nothing can be locked, as in a folder that cannot be written, or where another process holds
    the lock for too long, it goes on without.
    """
    lock = _open_lock(folder)
    if lock is None:
        yield
        return
    try:
        until = time.monotonic() + LOCK_S
        while not _try_lock(lock) and time.monotonic() < until:
            time.sleep(0.01)
        yield
    finally:
        os.close(lock)  # which unlocks it


def _open_lock(folder: str) -> int | None:
    if fcntl is None:
        return None
    try:
        return os.open(os.path.join(folder, LOCK_NAME), os.O_RDONLY | os.O_CREAT, 0o666)
    except OSError:
        return None


def _try_lock(lock: int) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _read_only_folders(source: str) -> list[str]:
    """Folders that may hold kernels of a source file, but that cannot be written here."""
    parent = os.path.dirname(os.path.abspath(source))
    folders = [os.path.join(parent, "__pycache__")]
    if numba.config.CACHE_DIR:
        own = _ReadOnlyPlace.get_suitable_cache_subpath(source)
        folders.insert(0, os.path.join(numba.config.CACHE_DIR, own))
    return [path for path in folders if os.path.isdir(path) and not os.access(path, os.W_OK)]


@cache
def source_stamp(source: Path, package: Path = Path(__file__).parent) -> str:
    """Fingerprint of a source file and of all of the package that its compiled code may hold."""
    digest = hashlib.sha256()
    for file in sorted(_sources(source, package)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _sources(source: Path, package: Path) -> set[Path]:
    """A source file, what it imports of the package, itself or in turn, and formulas of families.

    Which formula of a family a kernel calls is known only when it is compiled: all count.
    """
    found, waiting = {source}, [source]
    while waiting:
        file = waiting.pop()
        text = _text(file)
        others = [
            package.joinpath(*name.split(".")).with_suffix(".py")
            for name in _IMPORTED.findall(text)
        ]
        if _FAMILY.search(text):
            others += file.parent.glob("_*_kernels.py")
        for other in others:
            if other not in found and other.is_file():
                found.add(other)
                waiting.append(other)
    return found


@cache
def _text(source: Path) -> str:
    return source.read_text(encoding="utf-8")

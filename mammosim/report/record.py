"""The record of a run, written to run.json: enough to repeat it and to notice a difference."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from mammosim._version import VERSION
from mammosim.config import open_file
from mammosim.report.references import references_used

try:
    import resource
except ImportError:  # not a Unix
    resource = None  # type: ignore[assignment]

Status = Literal["done", "not converged", "interrupted", "refused"]

PACKAGES = (
    "numpy", "numba", "scipy", "pydicom", "highdicom", "spekpy", "xraylib",
    "SimpleITK", "itk-rtk",
)  # fmt: skip
"""Distributions whose version decides a result or a file."""

NOT_HASHED = ("run.json", "report.html")
"""Files of a run's folder that tell of the others, and hold times."""

_LINUX_STATUS = Path("/proc/self/status")
"""Where Linux tells a program's memory, proc_pid_status(5)."""

_BYTES_AT_ONCE = 1 << 20
"""Bytes of a file that are hashed at a time."""


def run_hash(
    settings: Mapping[str, Any], seed: int, version: str, inputs: Iterable[str] = ()
) -> str:
    """Hash of everything that decides a run's result.

    Parameters
    ----------
    settings : mapping
        The resolved configuration as plain values.
    seed : int
    version : str
        Version of mammosim.
    inputs : iterable of str
        Hashes of the input files (`file_hash`), so that another phantom under the same name is
        another run.

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits; the order of keys does not matter.

    Examples
    --------
    >>> run_hash({"a": 1, "b": 2}, 1, "0.1") == run_hash({"b": 2, "a": 1}, 1, "0.1")
    True
    """
    decides = {"settings": settings, "seed": seed, "version": version, "inputs": list(inputs)}
    text = json.dumps(decides, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def file_hash(path: str | PathLike[str]) -> str:
    """SHA-256 of a file's content.

    Parameters
    ----------
    path : path
        A regular file; read in blocks.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    OSError
        If it cannot be read, or is no regular file.
    """
    digest = hashlib.sha256()
    with open_file(path) as stream:
        while block := stream.read(_BYTES_AT_ONCE):
            digest.update(block)
    return digest.hexdigest()


def run_record(
    folder: str | PathLike[str],
    *,
    status: Status,
    seed: int,
    settings: Mapping[str, Any],
    stage_seconds: Mapping[str, float],
    warnings: Iterable[str] = (),
    run_hash: str = "",
) -> dict[str, Any]:
    """Gather what run.json holds, once all other files are written.

    Parameters
    ----------
    folder : path
        The run's folder.
    status : {"done", "not converged", "interrupted", "refused"}
        `refused` where a later stage found that something did not fit.
    seed : int
    settings : mapping
        The resolved configuration as plain values.
    stage_seconds : mapping of str to float
        Wall time of each stage, s.
    warnings : iterable of str
        One sentence each; a repeated one is kept once.
    run_hash : str
        See `run_hash`.

    Returns
    -------
    dict
        Plain values.
    """
    return {
        "status": status,
        "run_hash": run_hash,
        "seed": seed,
        "determinism": (
            "The same settings, seed, input and versions give the same bytes in every file but "
            f"{' and '.join(NOT_HASHED)}, whatever the number of threads."
        ),
        "versions": _versions(),
        "settings": dict(settings),
        "stage_seconds": {stage: round(seconds, 3) for stage, seconds in stage_seconds.items()},
        "peak_memory_mb": _peak_memory_mb(),
        "warnings": list(dict.fromkeys(warnings)),
        "references": [asdict(reference) for reference in references_used(settings)],
        "files": _file_hashes(Path(folder)),
    }


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "mammosim": VERSION}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _peak_memory_mb() -> float | None:
    """Largest resident size of this program so far, in 10^6 bytes; None where it is not told."""
    with suppress(OSError):  # Linux: getrusage(2) would count the parent's size before exec(2) too
        told = re.search(r"^VmHWM:\s*(\d+) kB$", _LINUX_STATUS.read_text(), re.MULTILINE)
        if told:
            return round(int(told[1]) * 1024 / 1e6, 1)
    if resource is None:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in KiB, macOS in bytes (getrusage(2) of each).
    return round(peak * (1 if sys.platform == "darwin" else 1024) / 1e6, 1)


def _file_hashes(folder: Path) -> dict[str, str]:
    """Hash of each file by its path in the folder; hidden files are not part of a run."""
    paths = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {
        path.as_posix(): file_hash(folder / path)
        for path in paths
        if path.as_posix() not in NOT_HASHED
        and not any(part.startswith(".") for part in path.parts)
    }

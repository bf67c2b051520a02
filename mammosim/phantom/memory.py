"""Whether a phantom fits into memory, before anything is allocated for it."""

from __future__ import annotations

import os
from pathlib import Path

try:
    import resource
except ImportError:  # not a Unix: no such limits there
    resource = None  # type: ignore[assignment]

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import VoxelFile

MEMINFO = Path("/proc/meminfo")
"""Linux: `MemAvailable` is what can be had without swapping (proc(5))."""

STATM = Path("/proc/self/statm")
"""Linux: the first number is the size of the address space, in pages (proc(5))."""

CGROUP = Path("/sys/fs/cgroup")
"""Limits of a container or batch job (Linux, Documentation/admin-guide/cgroup-v2)."""

LABEL_BYTES = 1
"""Of each voxel of the phantom made from the file."""

MAX_REDUCED = 16
"""Largest `phantom.reduce`: 0.05 mm becomes 0.8 mm."""


def available_bytes() -> int | None:
    """Memory that can be had now.

    Returns
    -------
    int or None
        Bytes; the least of what the system calls available, what the control group leaves and what
        the limit of the process leaves. None where none of them is told.
    """
    found = [_system_bytes(), _cgroup_bytes()]
    allowed = address_bytes()
    if allowed is not None:
        found.append(max(allowed - _mapped_bytes(), 0))
    return min((value for value in found if value is not None), default=None)


def address_bytes() -> int | None:
    """Limit of this process' memory (``ulimit -v`` or ``-d``).

    Returns
    -------
    int or None
        The lower of both soft limits, bytes; None where there is none, or the system has no limits.
        Limits of a control group, as of a container, are not looked at.
    """
    if resource is None:
        return None
    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    return min((limit for limit in limits if limit != resource.RLIM_INFINITY), default=None)


def _mapped_bytes() -> int:
    """Address space that this process has mapped; 0 where the system does not tell."""
    try:
        return int(STATM.read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError, IndexError):
        return 0


def _system_bytes() -> int | None:
    try:
        for line in MEMINFO.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def _cgroup_bytes() -> int | None:
    try:
        limit = (CGROUP / "memory.max").read_text(encoding="ascii").strip()
        used = (CGROUP / "memory.current").read_text(encoding="ascii").strip()
        return max(int(limit) - int(used), 0)
    except (OSError, ValueError):
        return None  # no such group, or the limit is "max"


def needed_bytes(opened: VoxelFile, step: int) -> int:
    """Memory that reading takes when of every `step` voxels along each axis one is kept."""
    kept = opened.count // step**3
    whole = opened.count * opened.dtype.itemsize * opened.whole_copies
    return whole + kept * (opened.dtype.itemsize + LABEL_BYTES)


def check_memory(opened: VoxelFile, step: int) -> None:
    """Refuse a phantom that does not fit into memory.

    Parameters
    ----------
    opened : VoxelFile
    step : int
        `phantom.reduce`.

    Raises
    ------
    InputError
        With both numbers, and with the reduction that would fit.
    """
    available, needed = available_bytes(), needed_bytes(opened, step)
    if available is None or needed <= available:
        return
    larger = range(step + 1, min(MAX_REDUCED, *opened.shape) + 1)
    fits = next((n for n in larger if needed_bytes(opened, n) <= available), None)
    if fits is not None:
        size = " x ".join(f"{fits * step_mm:g}" for step_mm in opened.voxel_mm)
        advice = f"reduce it: phantom.reduce: {fits} gives voxels of {size} mm"
    else:
        advice = "convert it to .mhd, which is read layer by layer, where more memory is available"
    raise InputError(
        f"{opened.path}: {opened.count / 1e6:.4g} million voxels take {needed / 1e9:.3g} GB to "
        f"read, {available / 1e9:.3g} GB are available; {advice}"
    )

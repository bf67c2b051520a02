"""Run the command line: ``python -m mammosim``."""

from __future__ import annotations

import sys

try:
    import resource
except ImportError:  # not a Unix: no such limits there
    resource = None  # type: ignore[assignment]

MIN_ADDRESS_BYTES = 950_000_000
"""Address space that Python takes with all libraries loaded, twice what it uses of it. Measured:
`mammosim check` works from 900 MB on; below, OpenBLAS and LLVM end the process without a word."""


def main() -> None:
    """Entry point of the command `mammosim`; says so where there is no memory to start in."""
    try:
        allowed = _address_bytes()
        if allowed is not None and allowed < MIN_ADDRESS_BYTES:
            raise MemoryError(
                f"a limit of {allowed / 1e6:.0f} MB is set, expected {MIN_ADDRESS_BYTES / 1e6:.0f} "
                "or more; see ulimit -v"
            )
        from mammosim.cli import main as command

        command()
    except (MemoryError, ImportError, OSError) as error:
        if not _is_lack_of_memory(error):
            raise
        sys.stderr.write(f"error: not enough memory to start ({error})\n")
        sys.exit(2)


def _address_bytes() -> int | None:
    """The limit of this process' address space, or None where there is none."""
    if resource is None:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if soft == resource.RLIM_INFINITY else int(soft)


def _is_lack_of_memory(error: BaseException) -> bool:
    """Also where a library cannot be loaded for it."""
    words = ("memory", "map segment", "allocate")
    return isinstance(error, MemoryError) or any(word in str(error) for word in words)


__all__ = ["main"]

if __name__ == "__main__":
    main()

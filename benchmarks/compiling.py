"""Where the time of a machine's first run goes: seconds that each kernel takes to compile.

    python benchmarks/compiling.py CONFIG [--set section.key=value ...]

Runs the command line with an empty cache of compiled code, into a temporary folder, and prints for
each function that Numba compiled its own seconds, those with all that it calls, and how many types
it was compiled for; the most expensive first.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import defaultdict
from typing import Any


class Stopwatch:
    """Seconds of functions that are compiled one within another."""

    def __init__(self) -> None:
        self.own: dict[str, float] = defaultdict(float)
        self.whole: dict[str, float] = defaultdict(float)
        self.types: dict[str, int] = defaultdict(int)
        self._open: list[tuple[float, float]] = []  # when begun, and seconds of what it calls

    def begin(self) -> None:
        """Another function begins."""
        self._open.append((time.perf_counter(), 0.0))

    def end(self, name: str) -> None:
        """The function that began last ends."""
        begun, within = self._open.pop()
        seconds = time.perf_counter() - begun
        self.own[name] += seconds - within
        self.whole[name] += seconds
        self.types[name] += 1
        if self._open:
            begun, within = self._open[-1]
            self._open[-1] = begun, within + seconds

    def table(self) -> str:
        """All functions, the most expensive first."""
        lines = ["   own   whole  types"]
        for name in sorted(self.own, key=lambda name: -self.own[name]):
            seconds = f"{self.own[name]:6.2f}  {self.whole[name]:6.2f}"
            lines.append(f"{seconds}  {self.types[name]:5}  {name}")
        return "\n".join(lines)


def watched(watch: Stopwatch) -> Any:
    """A listener to Numba's events that keeps the stopwatch."""
    from numba.core.event import Listener

    class Watcher(Listener):
        def on_start(self, event: Any) -> None:
            watch.begin()

        def on_end(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            watch.end(f"{function.__module__}.{function.__qualname__}")

    return Watcher()


def main() -> None:
    """Run the configuration given on the command line with nothing compiled."""
    watch, arguments = Stopwatch(), sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = f"{folder}/cache"  # Numba reads it when it is loaded
        from numba.core.event import install_listener

        from mammosim.cli import app

        begun = time.perf_counter()
        with install_listener("numba:compile", watched(watch)):
            app(["run", *arguments, "--output", f"{folder}/run"], standalone_mode=False)
        seconds = time.perf_counter() - begun
    print(watch.table())
    compiling = sum(watch.own.values())
    print(
        f"{seconds:.1f} s, of which {compiling:.1f} s to compile {sum(watch.types.values())} times"
    )


if __name__ == "__main__":
    main()

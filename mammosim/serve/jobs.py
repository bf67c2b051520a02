"""Runs in progress: each in a process of its own, one at a time; the others wait."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

Command = Callable[[Path, Path], Sequence[str]]
Status = Literal["waiting", "running", "done", "not converged", "interrupted", "refused", "failed"]

# as `mammosim run` ends
_STATUS_OF_EXIT: dict[int, Status] = {
    0: "done", 2: "refused", 3: "not converged", 130: "interrupted",
}  # fmt: skip

MAX_ROWS = 5000
"""Rows of a view's convergence kept for the curve; beyond, every second one is dropped."""


@dataclass
class Job:
    """One run.

    Parameters
    ----------
    folder : Path
        The run's folder.
    config : Path
        Its configuration.

    Attributes
    ----------
    status : str
    share : float
        Part that is done, 0 to 1.
    text : str
        The stage, and when the run will end.
    rows : dict of str to list of dict
        Rows of the solver's history, by the view's folder.
    said : list of str
        Errors and warnings, one line each.
    """

    folder: Path
    config: Path
    status: Status = "waiting"
    share: float = 0.0
    text: str = "waiting for another run"
    rows: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    process: subprocess.Popen[str] | None = None

    @property
    def is_over(self) -> bool:
        """Whether it has ended, one way or another."""
        return self.status not in ("waiting", "running")

    def start(self, command: Command) -> None:
        """Start its process, and follow its output."""
        words = [sys.executable, "-m", "mammosim", *command(self.config, self.folder)]
        self.status, self.text = "running", "starting"
        self.process = subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
            errors="replace",
        )  # fmt: skip
        for target in (self._follow, self._listen):
            threading.Thread(target=target, daemon=True).start()

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does: what was reached is saved."""
        if self.status == "waiting":
            self.status, self.text = "interrupted", "cancelled before it started"
        elif self.process is not None and self.process.poll() is None:
            self.text = "stopping, and saving what was reached"
            self.process.send_signal(signal.SIGINT)

    def _follow(self) -> None:
        assert self.process is not None
        assert self.process.stdout is not None
        for line in self.process.stdout:
            try:
                self.take(json.loads(line))
            except ValueError:
                continue  # the summary, in words
        status = self.process.wait()
        self.status = _STATUS_OF_EXIT.get(status, "failed")
        self.share = 1.0 if status == 0 else self.share
        self.text = self.status

    def _listen(self) -> None:
        assert self.process is not None
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said.append(line.strip())

    def take(self, event: Any) -> None:
        """Note an event of the run."""
        if not isinstance(event, dict) or "text" not in event:
            return
        self.share, self.text = float(event["share"]), str(event["text"])
        if isinstance(event.get("row"), dict):
            rows = self.rows.setdefault(str(event["view"]), [])
            rows.append(event["row"])
            if len(rows) > MAX_ROWS:
                del rows[1::2]


class Jobs:
    """All runs since the page was started, the latest last.

    Parameters
    ----------
    command : callable
        Gives the command line's arguments for a run of a configuration in a folder that prints
        its progress as events.
    """

    def __init__(self, command: Command) -> None:
        self._command = command
        self.all: list[Job] = []

    def add(self, job: Job) -> None:
        """Queue a run; it starts at once if no other is running."""
        self.all.append(job)
        self.advance()

    def advance(self) -> None:
        """Start the next run that waits, unless one is running."""
        if any(job.status == "running" for job in self.all):
            return
        waiting = next((job for job in self.all if job.status == "waiting"), None)
        if waiting is not None:
            waiting.start(self._command)

    def of(self, folder: Path) -> Job | None:
        """The latest run in a folder."""
        return next((job for job in reversed(self.all) if job.folder == folder), None)

    def stop(self) -> None:
        """Interrupt all, when the page is closed."""
        for job in self.all:
            if not job.is_over:
                job.cancel()

"""How far a cohort has come, and when it will be done."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from mammosim.pipeline import expected_end


@dataclass(frozen=True)
class Progress:
    """How far a cohort has come.

    Parameters
    ----------
    patients : int
        Number of patients in the cohort.
    found : int
        Finished before this start.
    made : int
        Finished since then.
    failed : int
    running : int
    workers : int
        Workers that are there.
    seconds : float
        Wall time since this start, s.
    """

    patients: int
    found: int = 0
    made: int = 0
    failed: int = 0
    running: int = 0
    workers: int = 0
    seconds: float = 0.0

    @property
    def done(self) -> int:
        """Patients with a finished run."""
        return self.found + self.made

    @property
    def waiting(self) -> int:
        """Patients that have not been begun."""
        return self.patients - self.done - self.failed - self.running

    @property
    def ended(self) -> bool:
        """Whether every patient is done or failed."""
        return self.done + self.failed >= self.patients

    @property
    def patients_per_hour(self) -> float:
        """Patients finished or failed an hour since this start; 0 before the first."""
        if self.seconds <= 0:
            return 0.0
        return 3600.0 * (self.made + self.failed) / self.seconds

    @property
    def seconds_left(self) -> float | None:
        """Expected time until the end, s; None where nothing tells."""
        if self.patients_per_hour <= 0:
            return None
        return 3600.0 * (self.waiting + self.running) / self.patients_per_hour

    def sentence(self, now: datetime) -> str:
        """All of it in one line; without an expected end once nothing is left to do.

        Examples
        --------
        >>> Progress(20, made=9, failed=1, running=2, workers=2, seconds=1800.0).sentence(
        ...     datetime(2024, 5, 1, 12, 0)
        ... )
        '9 of 20 done, 2 running, 1 failed, 20 patients per hour, ends about 12:30'
        >>> Progress(20, made=19, failed=1, seconds=3600.0).sentence(datetime(2024, 5, 1, 12, 0))
        '19 of 20 done, 0 running, 1 failed, 20 patients per hour'
        """
        parts = [f"{self.done} of {self.patients} done", f"{self.running} running"]
        parts.append(f"{self.failed} failed")
        if not self.workers and not self.ended:
            return ", ".join([*parts, "waiting for workers"])
        if self.seconds_left is not None:
            parts.append(f"{self.patients_per_hour:.3g} patients per hour")
            parts += [] if self.ended else [expected_end(now, self.seconds_left)]
        return ", ".join(parts)

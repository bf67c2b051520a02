"""How far a run has come, and when it will end, from its plan and the stages it reports."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from time import monotonic

from mammosim.pipeline.configuration import Plan

MAX_STAGE_SHARE = 0.95
"""Of a stage's planned time that may be counted before it ends."""

MIN_KNOWN_SHARE = 0.05
"""Part of a run from which its own pace is trusted, rather than the plan's."""

_STAGES = {
    "phantom": "making the breast",
    "compression": "compressing",
    "projection": "tracing rays",
    "acquisition": "exposing",
    "targets": "finding lesions on the image",
    "projections": "taking projections",
    "reconstruction": "reconstructing slices",
    "export": "writing volumes and images",
    "lesion shift": "comparing views",
    "biopsy": "compressing for biopsy",
    "uncertainty": "compressing again for the uncertainty",
    "report": "writing the report",
}
"""What each stage does, in words."""


def stage_in_words(view: str, stage: str) -> str:
    """What a run is doing, for the view whose folder is given.

    Examples
    --------
    >>> stage_in_words("LCC", "acquisition"), stage_in_words("", "report")
    ('LCC: exposing', 'writing the report')
    """
    doing = _STAGES.get(stage, stage)  # samples of the uncertainty count themselves in its name
    return f"{view}: {doing}" if view else doing


class RunProgress:
    """Follows a run by the stages that it reports, of several views at the same time or in turn.

    Parameters
    ----------
    plan : Plan
    clock : callable, optional
        Seconds, for tests.

    Notes
    -----
    The plan says how the stages' durations compare; the run's own pace so far says how fast this
    machine is. A first run, which compiles kernels, and stages that are kept from before make the
    estimate too long or too short; it is an estimate.
    """

    def __init__(self, plan: Plan, clock: Callable[[], float] = monotonic) -> None:
        self._stages, self._clock = plan.stages, clock
        self._total = max(sum(stage.seconds for stage in plan.stages), 1e-9)
        self._done: set[int] = set()
        self._running: dict[str, tuple[int, float]] = {}
        self._began = clock()

    def report(self, view: str, stage: str) -> None:
        """Note that a stage begins; the view's stage before it is done.

        All that the plan has before a stage of the whole run is done then, and what it has for the
        whole run before a stage of a view.
        """
        for name in list(self._running) if not view else ["", view]:
            if name in self._running:
                self._done.add(self._running.pop(name)[0])
        place = self._planned(view, stage)
        if place is None:
            return
        before = range(place)
        self._done.update(n for n in before if not view or not self._stages[n].view)
        self._running[view] = place, self._clock()

    def _planned(self, view: str, stage: str) -> int | None:
        """Place in the plan of a stage that begins; views on both sides are planned alike."""
        begun = self._done | {place for place, _ in self._running.values()}
        for place, planned in enumerate(self._stages):
            of_view = not planned.view or view.endswith(planned.view)
            if place not in begun and planned.stage == stage and of_view:
                return place
        return None

    @property
    def share(self) -> float:
        """Part of the run that is done, 0 to 1."""
        done, now = sum(self._stages[place].seconds for place in self._done), self._clock()
        for place, began in self._running.values():
            done += min(now - began, MAX_STAGE_SHARE * self._stages[place].seconds)
        return min(done / self._total, 1.0)

    @property
    def seconds_left(self) -> float:
        """Expected time until the end, s."""
        share = self.share
        if share < MIN_KNOWN_SHARE:
            return (1.0 - share) * self._total
        return (1.0 - share) / share * (self._clock() - self._began)

    def sentence(self, now: datetime) -> str:
        """Per cent and expected end.

        Examples
        --------
        >>> from mammosim.pipeline.configuration import PlannedStage
        >>> plan = Plan((), 1.0, (PlannedStage("CC", "compression", 60.0),
        ...                       PlannedStage("CC", "projection", 60.0)))
        >>> ticks = iter([0.0, 0.0, 60.0, 60.0, 60.0, 60.0])
        >>> progress = RunProgress(plan, lambda: next(ticks))
        >>> progress.report("LCC", "compression")
        >>> progress.report("LCC", "projection")
        >>> progress.sentence(datetime(2024, 5, 1, 12, 0))
        '50 %, ends about 12:01'
        """
        return f"{100.0 * self.share:.0f} %, {expected_end(now, self.seconds_left)}"


def expected_end(now: datetime, seconds_left: float) -> str:
    """When something ends, in words, with the day if it is another one.

    Examples
    --------
    >>> expected_end(datetime(2024, 5, 1, 23, 0), 7200.0)
    'ends about 2024-05-02 01:00'
    """
    end = now + timedelta(seconds=seconds_left)
    day = "" if end.date() == now.date() else f"{end:%Y-%m-%d} "
    return f"ends about {day}{end:%H:%M}"

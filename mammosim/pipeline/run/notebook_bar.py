"""A run's progress where it was started: a bar below the notebook's cell."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from html import escape
from time import monotonic
from typing import Any

from mammosim.pipeline.configuration import RunConfig, make_plan
from mammosim.pipeline.run_progress import RunProgress, stage_in_words
from mammosim.pipeline.study import OnProgress

SECONDS_PER_CHANGE = 0.5
"""Between two changes of the bar within a stage, so that messages do not pile up."""


@contextmanager
def notebook_bar(config: RunConfig, on_progress: OnProgress | None) -> Iterator[OnProgress | None]:
    """Show a bar in a Jupyter notebook, unless progress goes elsewhere.

    Parameters
    ----------
    config : RunConfig
    on_progress : callable or None
        Where progress goes.

    Yields
    ------
    callable or None
        What a run reports to: `on_progress`, or the bar where that is None, or None outside of
        notebooks.
    """
    if on_progress is not None or "ipykernel" not in sys.modules:
        yield on_progress
        return
    from IPython.display import HTML, display

    run, last = RunProgress(make_plan(config)), 0.0
    bar = display(HTML(_bar(0.0, "starting")), display_id=True)

    def show(view: str, stage: str, row: Any) -> None:
        nonlocal last
        if row is None:
            run.report(view, stage)
        if row is None or monotonic() - last > SECONDS_PER_CHANGE:
            last = monotonic()
            text = f"{stage_in_words(view, stage)} ({run.sentence(datetime.now())})"
            bar.update(HTML(_bar(run.share, text)))

    ended = "stopped"
    try:
        yield show
        ended = "done"
    finally:
        bar.update(HTML(_bar(1.0 if ended == "done" else run.share, ended)))


def _bar(share: float, text: str) -> str:
    words = escape(text)
    return (
        f'<progress value="{share:.3f}" max="1" aria-label="Progress of the run"></progress> '
        f"<span>{words}</span>"
    )

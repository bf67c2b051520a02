"""How many views of a run are made at the same time."""

from __future__ import annotations

from mammosim._jit import kernel_threads
from mammosim.phantom import available_bytes
from mammosim.pipeline.configuration import RunConfig, make_plan


def views_at_once(config: RunConfig) -> int:
    """How many views of a run are made at the same time.

    Parameters
    ----------
    config : RunConfig

    Returns
    -------
    int
        As many as its kernels may use threads, if memory suffices for all views; else one.

    Notes
    -----
    Half of a compression runs on one thread however many there are. What views keep until the run
    ends is most of their memory, so that `make_plan` counts all in any case.
    """
    views = sum(len(one.resolved_views) for one in config.sides)
    available = available_bytes()
    if available is not None and make_plan(config).memory_gb * 1e9 > available:
        return 1
    return max(min(views, kernel_threads()), 1)

"""One run, in the order in which a mammogram is made: read `simulation` first."""

from mammosim._heap import keep_freed_memory, return_freed_memory
from mammosim.pipeline.run.observer import Observe, RunObserver, unobserved
from mammosim.pipeline.run.simulation import simulate, simulate_series, simulate_view

__all__ = [
    "Observe",
    "RunObserver",
    "keep_freed_memory",
    "return_freed_memory",
    "simulate",
    "simulate_series",
    "simulate_view",
    "unobserved",
]

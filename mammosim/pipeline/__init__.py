"""A whole run: the configuration's sections in order, and the calls in order."""

from mammosim.pipeline.beforehand import check_before
from mammosim.pipeline.plan import Plan, make_plan
from mammosim.pipeline.run import Study, ViewResult, simulate
from mammosim.pipeline.run_config import RunConfig, ViewSettings, load_config
from mammosim.pipeline.save import RunFolder

__all__ = [
    "Plan",
    "RunConfig",
    "RunFolder",
    "Study",
    "ViewResult",
    "ViewSettings",
    "check_before",
    "load_config",
    "make_plan",
    "simulate",
]

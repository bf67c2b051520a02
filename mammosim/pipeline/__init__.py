"""A whole run: the configuration's sections in order, and the calls in order."""

from mammosim.pipeline.beforehand import check_before, check_settings
from mammosim.pipeline.lock import is_being_written, writing
from mammosim.pipeline.plan import Plan, make_plan
from mammosim.pipeline.run import Study, ViewResult, simulate
from mammosim.pipeline.run_config import (
    RunConfig,
    apply_change,
    config_of,
    is_cohort,
    load_config,
)
from mammosim.pipeline.save import RunFolder, check_output, is_finished, read_record, title_of
from mammosim.pipeline.view_settings import ViewSettings

__all__ = [
    "Plan",
    "RunConfig",
    "RunFolder",
    "Study",
    "ViewResult",
    "ViewSettings",
    "apply_change",
    "check_before",
    "check_output",
    "check_settings",
    "config_of",
    "is_being_written",
    "is_cohort",
    "is_finished",
    "load_config",
    "make_plan",
    "read_record",
    "simulate",
    "title_of",
    "writing",
]

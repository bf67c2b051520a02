"""What a run is asked to do: its settings, its needs, and what can be refused in advance."""

from mammosim.pipeline.configuration.preflight import check_before, check_detectors, check_settings
from mammosim.pipeline.configuration.run_config import (
    RunConfig,
    apply_change,
    config_of,
    input_paths,
    is_cohort,
    load_config,
    without_paths,
)
from mammosim.pipeline.configuration.run_plan import PLANNED_CORES, Plan, make_plan
from mammosim.pipeline.configuration.view_settings import VIEW_SECTIONS, ViewSettings

__all__ = [
    "PLANNED_CORES",
    "VIEW_SECTIONS",
    "Plan",
    "RunConfig",
    "ViewSettings",
    "apply_change",
    "check_before",
    "check_detectors",
    "check_settings",
    "config_of",
    "input_paths",
    "is_cohort",
    "load_config",
    "make_plan",
    "without_paths",
]

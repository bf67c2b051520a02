"""What a run is asked to do: its settings, its needs, and what can be refused in advance."""

from mammosim.pipeline.configuration.input_files import input_paths, without_paths
from mammosim.pipeline.configuration.keys import RunKeys
from mammosim.pipeline.configuration.load_config import (
    apply_change,
    config_of,
    given_config,
    is_cohort,
    load_config,
)
from mammosim.pipeline.configuration.preflight import (
    check_before,
    check_compression,
    check_settings,
)
from mammosim.pipeline.configuration.resolved_view import BiopsyPosition, ResolvedView
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.pipeline.configuration.run_plan import (
    PLANNED_CORES,
    Plan,
    PlannedStage,
    check_memory_limit,
    make_plan,
)
from mammosim.pipeline.configuration.view_settings import VIEW_SECTIONS, ViewSettings

__all__ = [
    "PLANNED_CORES",
    "VIEW_SECTIONS",
    "BiopsyPosition",
    "Plan",
    "PlannedStage",
    "ResolvedView",
    "RunConfig",
    "RunKeys",
    "ViewSettings",
    "apply_change",
    "check_before",
    "check_compression",
    "check_memory_limit",
    "check_settings",
    "config_of",
    "given_config",
    "input_paths",
    "is_cohort",
    "load_config",
    "make_plan",
    "without_paths",
]

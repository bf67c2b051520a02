"""A whole run: the configuration's sections in order, and the calls in order.

Begin with `run`, a whole run on one screen. `configuration` holds what a run is asked to do,
`folder` the files it writes and the stages it keeps, `locate` the way back from its pictures.
"""

from mammosim.pipeline.configuration import (
    PLANNED_CORES,
    Plan,
    PlannedStage,
    ResolvedView,
    RunConfig,
    ViewSettings,
    apply_change,
    check_before,
    check_memory_limit,
    check_settings,
    config_of,
    is_cohort,
    load_config,
    make_plan,
)
from mammosim.pipeline.folder import (
    STAGES_FOLDER,
    RunFolder,
    is_being_written,
    is_finished,
    read_record,
    refuse_own_configuration,
    save_study,
    title_of,
    writing,
)
from mammosim.pipeline.locate import LocatedInRun, SavedView, locate_in_run, read_views
from mammosim.pipeline.run import (
    Observe,
    keep_freed_memory,
    return_freed_memory,
    simulate,
    simulate_series,
    simulate_view,
)
from mammosim.pipeline.run_progress import RunProgress, expected_end, stage_in_words
from mammosim.pipeline.study import OnProgress, Study, ViewResult

__all__ = [
    "PLANNED_CORES",
    "STAGES_FOLDER",
    "LocatedInRun",
    "Observe",
    "OnProgress",
    "Plan",
    "PlannedStage",
    "ResolvedView",
    "RunConfig",
    "RunFolder",
    "RunProgress",
    "SavedView",
    "Study",
    "ViewResult",
    "ViewSettings",
    "apply_change",
    "check_before",
    "check_memory_limit",
    "check_settings",
    "config_of",
    "expected_end",
    "is_being_written",
    "is_cohort",
    "is_finished",
    "keep_freed_memory",
    "load_config",
    "locate_in_run",
    "make_plan",
    "read_record",
    "read_views",
    "refuse_own_configuration",
    "return_freed_memory",
    "save_study",
    "simulate",
    "simulate_series",
    "simulate_view",
    "stage_in_words",
    "title_of",
    "writing",
]

"""Many virtual patients from one file, on Dask: nothing lost, and the same whatever happens."""

from mammosim.cohort.cohort_progress import Progress
from mammosim.cohort.description import Cohort, load_cohort
from mammosim.cohort.dispatch import run_cohort
from mammosim.cohort.plan import CohortPlan, plan_cohort
from mammosim.cohort.schema import cohort_schema
from mammosim.cohort.settings import CohortSettings, DatasetSettings, SplitSettings
from mammosim.cohort.status import CohortStatus, cohort_status

__all__ = [
    "Cohort",
    "CohortPlan",
    "CohortSettings",
    "CohortStatus",
    "DatasetSettings",
    "Progress",
    "SplitSettings",
    "cohort_schema",
    "cohort_status",
    "load_cohort",
    "plan_cohort",
    "run_cohort",
]

"""What a cohort will take, before any patient is made."""

from __future__ import annotations

from dataclasses import dataclass

from mammosim.cohort.cluster import Workers, share_machine
from mammosim.cohort.dataset import check_exports
from mammosim.cohort.description import Cohort, dotted
from mammosim.cohort.patient import worker_gb
from mammosim.errors import InputError
from mammosim.pipeline import PLANNED_CORES, Plan, check_before, check_settings, make_plan

FIRST_PATIENTS = 50
"""Patients that are looked at before any is begun."""


@dataclass(frozen=True)
class CohortPlan:
    """What a cohort takes, judged by its first patients.

    Parameters
    ----------
    lines : tuple of str
        The cohort and its first patient in words.
    workers : Workers
        Those that there is room for on this machine.
    memory_gb : float
        Memory of a worker with the largest patient, GB.
    hours : float
        On this machine.
    warnings : tuple of str
        Doubts about the settings of the first patients.
    """

    lines: tuple[str, ...]
    workers: Workers
    memory_gb: float
    hours: float
    warnings: tuple[str, ...] = ()


def plan_cohort(cohort: Cohort) -> CohortPlan:
    """Check a cohort's first patients and estimate what all take.

    Raises
    ------
    InputError
        With one line a mistake, if any of the first patients cannot be made, or none would fit
        this machine.
    """
    plans, problems = first_plans(cohort)
    if problems:
        raise InputError(problems)
    first = check_before(cohort.config_of(0))
    memory_gb = max(map(worker_gb, plans))
    workers = share_machine(memory_gb, cohort.patients, None, cohort.settings.memory_gb)
    minutes = cohort.patients * sum(plan.minutes for plan in plans) / len(plans)
    hours = minutes / 60.0 * PLANNED_CORES / (workers.count * workers.threads)
    warnings = dict.fromkeys([*first, *(text for plan in plans for text in plan.warnings)])
    return CohortPlan(_lines(cohort, plans), workers, memory_gb, hours, tuple(warnings))


def first_plans(cohort: Cohort) -> tuple[list[Plan], list[str]]:
    """Plans of the first patients that can be made, and what is wrong with the others."""
    plans: list[Plan] = []
    problems: list[str] = []
    for patient in range(min(cohort.patients, FIRST_PATIENTS)):
        try:
            config = cohort.config_of(patient)
            check_exports(config, cohort.settings.dataset, cohort.where)
            check_settings(config)
            plans.append(make_plan(config))
        except InputError as error:
            problems += error.problems
    return plans, list(dict.fromkeys(problems))


def _lines(cohort: Cohort, plans: list[Plan]) -> tuple[str, ...]:
    lines = [f"{cohort.title}: {cohort.patients} patients, seed {cohort.seed}"]
    if cohort.distributions:
        lines.append("drawn: " + ", ".join(dotted(path) for path in cohort.distributions))
    if cohort.patients > len(plans):
        lines.append(f"the first {len(plans)} patients were checked")
    return (*lines, *(f"patient 0: {line}" for line in plans[0].lines))

"""What a run answers about its lesions beside the table."""

from __future__ import annotations

from dataclasses import dataclass

from mammosim.targets.biopsy import BiopsyResult
from mammosim.targets.uncertainty import ShiftUncertainty
from mammosim.targets.view_rules import RuleError


@dataclass(frozen=True)
class LesionShiftResults:
    """Answers beside the table of targets; what was not asked for is empty.

    Parameters
    ----------
    rules : tuple of RuleError
        How well the rules between views hold.
    biopsy : tuple of BiopsyResult
    uncertainty : tuple of ShiftUncertainty
    notes : tuple of str
        Warnings, one sentence each.
    """

    rules: tuple[RuleError, ...] = ()
    biopsy: tuple[BiopsyResult, ...] = ()
    uncertainty: tuple[ShiftUncertainty, ...] = ()
    notes: tuple[str, ...] = ()

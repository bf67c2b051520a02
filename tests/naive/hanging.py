"""How a viewer sorts an exam's series into four slots: the rules of OHIF's mammography protocol.

Written down from OHIF Viewers 3: the rules from `mammoDisplaySetSelector.ts`, what they mean from
`HPMatcher.js` and `validator.js` (since its constraints take lists). A rule that holds adds its
weight, or 1 where that is 0 or missing; a slot takes, among the series that meet what it requires,
the one with the most weight, the first of them in the order of the study.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

CC, MLO = "SCT:399162004", "SCT:399368009"


class Rule(NamedTuple):
    """One rule of a slot: an attribute, what is asked of it, and what it counts for."""

    attribute: str
    holds: Callable[[list[str]], bool]
    weight: int = 1
    required: bool = False


def contains(*texts: str) -> Callable[[list[str]], bool]:
    """Any item of the value has any of the texts in it."""
    return lambda items: any(text in item for item in items for text in texts)


def equals(*texts: str) -> Callable[[list[str]], bool]:
    """The value is these items in this order; one text alone is compared with the first item."""
    return lambda items: items == list(texts) if len(texts) > 1 else items[0] == texts[0]


def never(rule: Callable[[list[str]], bool]) -> Callable[[list[str]], bool]:
    """The opposite of a constraint, as `doesNotContain`."""
    return lambda items: not rule(items)


NO_RIGHT_BREAST = Rule("orientation", never(contains("P", "FL")), required=True)
"""Of the slot RMLO. The rows of a right breast run to posterior (P), so that this refuses every one
that is stored as DICOM demands: OHIF shows another left view there, or none."""

SLOTS: dict[str, list[Rule]] = {
    "LCC": [
        Rule("view", contains(CC), 10),
        Rule("orientation", contains("L"), 5),
        Rule("description", contains("L CC"), 20),
    ],
    "RCC": [
        Rule("view", contains(CC), 10),
        Rule("orientation", equals("P", "L"), 5),
        Rule("orientation", never(equals("A", "R")), required=True),
        Rule("description", contains("CC"), 20),
    ],
    "LMLO": [
        Rule("view", contains(MLO), 10),
        Rule("view", never(equals(CC)), required=True),
        Rule("orientation", equals("A", "R"), 5),
        Rule("description", contains("L MLO"), 20),
    ],
    "RMLO": [
        Rule("view", contains(MLO), 10),
        Rule("view", never(equals(CC)), required=True),
        NO_RIGHT_BREAST,
        Rule("orientation", equals("P", "L"), 5),
        Rule("orientation", equals("A", "FR"), 5),
        Rule("description", contains("R MLO"), 20),
        Rule("description", never(contains("CC")), required=True),
        Rule("description", never(equals("L MLO")), required=True),
    ],
}


def hang(datasets: list, as_published: bool = False) -> dict[str, object]:
    """The data set that each slot shows, None where none meets what it requires.

    `NO_RIGHT_BREAST` is left out unless the rules are to be `as_published`.
    """
    series = [
        {
            "view": [f"{code.CodingSchemeDesignator}:{code.CodeValue}" for code in
                     d.ViewCodeSequence],
            "orientation": list(d.PatientOrientation),
            "description": [d.SeriesDescription],
            "dataset": d,
        }
        for d in sorted(datasets, key=lambda d: int(d.SeriesNumber))
    ]  # fmt: skip
    shown: dict[str, object] = {}
    for slot, listed in SLOTS.items():
        rules = [rule for rule in listed if as_published or rule is not NO_RIGHT_BREAST]
        fit = [
            one for one in series
            if all(rule.holds(one[rule.attribute]) for rule in rules if rule.required)
        ]  # fmt: skip
        best = max(fit, key=lambda one: _score(one, rules), default=None)
        shown[slot] = best and best["dataset"]
    return shown


def _score(series: dict, rules: list[Rule]) -> int:
    return sum(rule.weight for rule in rules if rule.holds(series[rule.attribute]))

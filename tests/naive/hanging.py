"""How a viewer sorts an exam's series into four slots: the rules of OHIF's mammography protocol.

Written down from `extensions/default/src/hangingprotocols/utils/mammoDisplaySetSelector.ts` of
OHIF Viewers 3: each slot takes, among the series that meet what it requires, the one with the most
weight, the first of them in the order of the study.
"""

from __future__ import annotations

from collections.abc import Callable

CC, MLO = "SCT:399162004", "SCT:399368009"
Rule = tuple[int, Callable[[dict], bool]]


def _view(code: str) -> Callable[[dict], bool]:
    return lambda series: code in series["view"]


def _says(text: str) -> Callable[[dict], bool]:
    return lambda series: text in series["description"]


def _is(*letters: str) -> Callable[[dict], bool]:
    return lambda series: list(series["orientation"]) == list(letters)


def _never(rule: Callable[[dict], bool]) -> Callable[[dict], bool]:
    return lambda series: not rule(series)


WEIGHTS: dict[str, list[Rule]] = {
    "LCC": [(10, _view(CC)), (5, lambda s: "L" in s["orientation"]), (20, _says("L CC"))],
    "RCC": [(10, _view(CC)), (5, _is("P", "L")), (20, _says("CC"))],
    "LMLO": [(10, _view(MLO)), (5, _is("A", "R")), (20, _says("L MLO"))],
    "RMLO": [(10, _view(MLO)), (5, _is("P", "L")), (5, _is("A", "FR")), (20, _says("R MLO"))],
}
REQUIRED: dict[str, list[Callable[[dict], bool]]] = {
    "LCC": [],
    "RCC": [_never(_is("A", "R"))],
    "LMLO": [_never(_view(CC))],
    "RMLO": [
        _never(_view(CC)),
        _never(lambda s: {"P", "FL"} <= set(s["orientation"]) and s["side"] == "L"),
        _never(_says("CC")),
        lambda s: s["description"] != "L MLO",
    ],
}


def hang(datasets: list) -> dict[str, object]:
    """The data set that each slot shows."""
    series = [
        {
            "view": f"{d.ViewCodeSequence[0].CodingSchemeDesignator}:"
            f"{d.ViewCodeSequence[0].CodeValue}",
            "orientation": d.PatientOrientation,
            "description": d.SeriesDescription,
            "side": d.ImageLaterality,
            "dataset": d,
        }
        for d in sorted(datasets, key=lambda d: int(d.SeriesNumber))
    ]
    shown = {}
    for slot, rules in WEIGHTS.items():
        fit = [one for one in series if all(required(one) for required in REQUIRED[slot])]
        best = max(fit, key=lambda one: sum(weight for weight, rule in rules if rule(one)))
        shown[slot] = best["dataset"]
    return shown

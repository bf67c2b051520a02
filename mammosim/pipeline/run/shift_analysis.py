"""What a run answers about its lesions beside the table: rules, biopsy, and how sure it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast, CompressionSettings, Sample, Sampler, compress
from mammosim.errors import NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.pipeline.configuration.view_settings import ViewSettings
from mammosim.targets import (
    BiopsyResult,
    Origin,
    RuleError,
    ShiftAnswers,
    ShiftUncertainty,
    Target,
    UncertaintySettings,
    aim_needles,
    draw_samples,
    rule_errors,
    sampled_shifts,
    target_doubts,
    target_origins,
    touching_lesions,
    uncertainties,
)

if TYPE_CHECKING:
    from mammosim.pipeline.run.simulation import ViewResult

Tell = Callable[[str, str, np.void | None], None]

MOST_NAMED = 5
"""Samples without equilibrium that a warning describes."""


@dataclass(frozen=True, eq=False)
class _Position:
    """The breast as it is held for the biopsy, and what it was held with."""

    squeezed: CompressedBreast
    settings: CompressionSettings


def shift_answers(
    breast: BreastPhantom, views: Mapping[str, ViewResult], config: RunConfig, tell: Tell
) -> ShiftAnswers:
    """Answer what the configuration asks about the targets of a run's views.

    Parameters
    ----------
    breast : BreastPhantom
    views : mapping of str to ViewResult
        By folder, in the order of the configuration's views; what was not reached is left out.
    config : RunConfig
    tell : callable
        Told of progress.
    """
    wanted = {
        breast.laterality + settings.label: settings
        for settings in config.views
        if breast.laterality + settings.label in views
    }
    wanted = {name: settings for name, settings in wanted.items() if views[name].targets}
    seen = {name: views[name] for name in wanted}
    notes = list(touching_lesions(breast))
    origins = target_origins(breast)
    for result in seen.values():
        notes += target_doubts(result.squeezed, result.targets, origins)
    positions: dict[str, _Position] = {}
    biopsy: list[BiopsyResult] = []
    if config.targets.biopsy is not None:
        tell("", "biopsy", None)
        positions = _positions(breast, seen, wanted, config, notes)
        for name, position in positions.items():
            result, needle = seen[name], config.targets.biopsy.needle
            biopsy += aim_needles(result.squeezed, result.targets, position.squeezed, needle)
    spread: list[ShiftUncertainty] = []
    if config.targets.uncertainty is not None:
        spread = _spread(origins, seen, wanted, positions, config, tell, notes)
    return ShiftAnswers(_rules(seen), tuple(biopsy), tuple(spread), tuple(notes))


def with_ellipsoids(
    targets: Sequence[Target], spread: Sequence[ShiftUncertainty]
) -> tuple[Target, ...]:
    """Rows of the table with the semi-axes of their ellipsoids."""
    axes = {(row.target_id, row.view): (row.long_mm, row.middle_mm, row.short_mm) for row in spread}
    filled = []
    for target in targets:
        found = axes.get((target.target_id, target.view))
        if found is not None:
            target = replace(
                target, ellipsoid_long_mm=found[0], ellipsoid_middle_mm=found[1],
                ellipsoid_short_mm=found[2],
            )  # fmt: skip
        filled.append(target)
    return tuple(filled)


def _rules(seen: Mapping[str, ViewResult]) -> tuple[RuleError, ...]:
    plain = {
        result.squeezed.view.label: (result.targets, result.mammogram.gantry)
        for result in seen.values()
        if result.mammogram is not None and not result.squeezed.view.tomosynthesis
    }
    return tuple(rule_errors(plain))


def _positions(
    breast: BreastPhantom,
    seen: Mapping[str, ViewResult],
    wanted: Mapping[str, ViewSettings],
    config: RunConfig,
    notes: list[str],
) -> dict[str, _Position]:
    """The breast at biopsy for each view's mammogram; equal positions are computed once."""
    made: dict[str, CompressedBreast] = {}
    for name, result in seen.items():
        own = config.section_for(wanted[name], "compression")
        made[f"{wanted[name].view} {own.model_dump_json()}"] = result.squeezed
    positions = {}
    for name in seen:
        view_name, settings = config.biopsy_section(wanted[name])
        key = f"{view_name} {settings.model_dump_json()}"
        if key not in made:
            view = View(view_name, breast.laterality, settings.mlo_angle_deg)
            given = settings.model_dump(mode="json", exclude_unset=True)
            try:
                made[key] = compress(breast, view, seed=config.seed, **given)
            except NotConverged as error:
                made[key] = error.reached
                notes.append(f"biopsy for {name}: {error}")
        positions[name] = _Position(made[key], settings)
    return positions


def _spread(
    origins: Sequence[Origin],
    seen: Mapping[str, ViewResult],
    wanted: Mapping[str, ViewSettings],
    positions: Mapping[str, _Position],
    config: RunConfig,
    tell: Tell,
    notes: list[str],
) -> list[ShiftUncertainty]:
    """Draw samples of every view, and of its biopsy position with the same tissue."""
    by_view: dict[str, NDArray[np.float64]] = {}
    at_biopsy: dict[str, NDArray[np.float64]] = {}
    done: dict[int, NDArray[np.float64]] = {}
    for name, result in seen.items():
        tell(name, "uncertainty", None)
        label = result.squeezed.view.label
        held = _Position(result.squeezed, config.section_for(wanted[name], "compression"))
        by_view[label] = _sampled(origins, held, name, config, partial(tell, name), notes)
        if name in positions:
            position = positions[name]
            key = id(position.squeezed)
            if key not in done:
                what = f"biopsy {position.squeezed.view.folder}"
                done[key] = _sampled(origins, position, what, config, partial(tell, name), notes)
            at_biopsy[label] = done[key]
    return uncertainties(origins, by_view, at_biopsy if positions else None)


def _sampled(
    origins: Sequence[Origin],
    held: _Position,
    what: str,
    config: RunConfig,
    tell: Callable[[str, np.void], None],
    notes: list[str],
) -> NDArray[np.float64]:
    """Shift of each target in each sample of one position, [sample, target, 3], mm."""
    settings = config.targets.uncertainty or UncertaintySettings()
    if held.squeezed.model == "none":  # nothing is held, nothing varies
        return np.zeros((settings.samples, len(origins), 3))
    sampler = Sampler(held.squeezed, held.settings)
    samples = draw_samples(settings, sampler.groups, what, config.seed)

    def watch(number: int, row: np.void) -> None:
        tell(f"uncertainty, sample {number + 1} of {len(samples)}", row)

    found = sampled_shifts(sampler, origins, samples, watch)
    lost = np.flatnonzero(np.isnan(found).any(axis=(1, 2)))
    if lost.size:
        notes.append(_left_out(what, samples, lost.tolist()))
    return found


def _left_out(what: str, samples: Sequence[Sample], lost: Sequence[int]) -> str:
    """One sentence that counts the samples without equilibrium and names them."""
    named = "; ".join(f"{number + 1} ({samples[number]})" for number in lost[:MOST_NAMED])
    more = f"; and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
    return (
        f"{what}: {len(lost)} of {len(samples)} samples did not converge and were left out: "
        f"{named}{more}"
    )

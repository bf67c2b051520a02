"""Results about lesions in addition to the table: view rules, biopsy and uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import (
    CompressedBreast,
    CompressionSettings,
    Sample,
    Sampler,
    compress,
    in_posture,
    posture_caution,
)
from mammosim.errors import NotConverged
from mammosim.phantom import BreastPhantom
from mammosim.pipeline.configuration import ResolvedView, RunConfig
from mammosim.pipeline.study import OnProgress, ViewResult
from mammosim.targets import (
    BiopsyResult,
    LesionShiftResults,
    RuleError,
    ShiftUncertainty,
    Target,
    UncertaintySettings,
    UncompressedTarget,
    aim_needles,
    draw_samples,
    mean_shift_mm,
    rule_errors,
    sampled_shifts,
    target_origins,
    target_warnings,
    touching_lesions,
    uncertainties,
)

MAX_NAMED = 5
"""Samples without equilibrium that a warning describes."""


@dataclass(frozen=True, eq=False)
class _Position:
    """The breast as it is held, and the settings of that compression."""

    compressed: CompressedBreast
    settings: CompressionSettings


def exam_results(
    breasts: Sequence[BreastPhantom],
    views: Mapping[str, ViewResult],
    config: RunConfig,
    on_progress: OnProgress,
) -> LesionShiftResults:
    """Answer what the configuration asks about the targets of each breast, one after the other.

    Parameters
    ----------
    breasts : sequence of BreastPhantom
    views : mapping of str to ViewResult
        By folder; what was not reached is left out.
    config : RunConfig
    on_progress : callable
        Called with each stage, and with rows of the solver's history.
    """
    rules: list[RuleError] = []
    biopsy: list[BiopsyResult] = []
    spread: list[ShiftUncertainty] = []
    notes: list[str] = []
    for one, breast in zip(config.sides, breasts, strict=True):
        own = {
            name: view for name, view in views.items()
            if view.compressed.view.laterality == breast.laterality
        }  # fmt: skip
        found = lesion_shift_results(breast, own, one, on_progress)
        rules += found.rules
        biopsy += found.biopsy
        spread += found.uncertainty
        notes += found.notes
    return LesionShiftResults(tuple(rules), tuple(biopsy), tuple(spread), tuple(notes))


def lesion_shift_results(
    breast: BreastPhantom,
    views: Mapping[str, ViewResult],
    config: RunConfig,
    on_progress: OnProgress,
) -> LesionShiftResults:
    """Answer what the configuration asks about the targets of one breast's views.

    Parameters
    ----------
    breast : BreastPhantom
    views : mapping of str to ViewResult
        By folder, in the order of the configuration's views; what was not reached is left out.
    config : RunConfig
    on_progress : callable
        Called with each stage, and with rows of the solver's history.
    """
    seen = {folder: result for folder, result in views.items() if result.targets}
    settings = {view.position(breast.laterality).folder: view for view in config.resolved_views}
    origins = target_origins(breast)
    notes = list(touching_lesions(breast))
    for result in seen.values():
        if result.paths is not None:
            gantry = result.paths.gantry
            notes += target_warnings(result.compressed, result.targets, origins, gantry)
    positions: dict[str, _Position] = {}
    biopsy: list[BiopsyResult] = []
    if config.targets.biopsy is not None:
        on_progress("", "biopsy", None)
        positions, not_held = _biopsy_positions(breast, seen, settings, config.seed)
        notes += not_held
        for folder, position in positions.items():
            result, needle = seen[folder], config.targets.biopsy.needle
            biopsy += aim_needles(result.compressed, result.targets, position.compressed, needle)
    spread: list[ShiftUncertainty] = []
    if config.targets.uncertainty is not None:
        at_mammogram = {
            folder: _Position(result.compressed, settings[folder].compression)
            for folder, result in seen.items()
        }
        spread, lost = _spread(origins, at_mammogram, positions, config, on_progress)
        first = min((row.target_id for view in seen.values() for row in view.targets), default=1)
        spread = [replace(row, target_id=row.target_id + first - 1) for row in spread]
        notes += lost
    return LesionShiftResults(_rules(seen), tuple(biopsy), tuple(spread), tuple(notes))


def with_ellipsoids(
    views: Mapping[str, ViewResult], spread: Sequence[ShiftUncertainty]
) -> dict[str, ViewResult]:
    """Views whose rows of the table hold the semi-axes of their ellipsoids."""
    axes = {(row.target_id, row.view): (row.long_mm, row.middle_mm, row.short_mm) for row in spread}

    def filled(target: Target) -> Target:
        found = axes.get((target.target_id, target.view))
        if found is None:
            return target
        return replace(
            target, ellipsoid_long_mm=found[0], ellipsoid_middle_mm=found[1],
            ellipsoid_short_mm=found[2],
        )  # fmt: skip

    return {
        folder: replace(view, targets=tuple(map(filled, view.targets)))
        for folder, view in views.items()
    }


def _rules(seen: Mapping[str, ViewResult]) -> tuple[RuleError, ...]:
    """Of each two standard views; one with a title of its own is another picture of such a view."""
    plain = {
        result.compressed.view.label: (result.targets, result.mammogram.gantry)
        for result in seen.values()
        if result.mammogram is not None
        and not (result.compressed.view.tomosynthesis or result.compressed.view.title)
    }
    return tuple(rule_errors(plain))


def _biopsy_positions(
    breast: BreastPhantom,
    seen: Mapping[str, ViewResult],
    settings: Mapping[str, ResolvedView],
    seed: int,
) -> tuple[dict[str, _Position], list[str]]:
    """The breast at biopsy for each view's mammogram, and which did not converge.

    Equal positions are computed once.
    """
    made = {
        _key(settings[folder].view, settings[folder].compression): result.compressed
        for folder, result in seen.items()
    }
    positions: dict[str, _Position] = {}
    notes = []
    for folder in seen:
        biopsy = settings[folder].biopsy
        if biopsy is None:
            continue
        key = _key(biopsy.view, biopsy.compression, biopsy.posture)
        if key not in made:
            view = biopsy.position(breast.laterality)
            try:
                if biopsy.posture is not None:
                    notes.append(f"biopsy for {folder}: {posture_caution(breast)}")
                    made[key] = in_posture(breast, view, biopsy.compression, biopsy.posture)
                else:
                    made[key] = compress(breast, view, biopsy.compression, seed=seed)
            except NotConverged as error:
                made[key] = error.reached
                notes.append(f"biopsy for {folder}: {error}")
        positions[folder] = _Position(made[key], biopsy.compression)
    return positions, notes


def _key(view: str, compression: CompressionSettings, posture: str | None = None) -> str:
    return f"{view} {posture} {compression.model_dump_json()}"


def _spread(
    origins: Sequence[UncompressedTarget],
    at_mammogram: Mapping[str, _Position],
    at_biopsy: Mapping[str, _Position],
    config: RunConfig,
    on_progress: OnProgress,
) -> tuple[list[ShiftUncertainty], list[str]]:
    """Draw samples of every view, and of its biopsy position with the same tissue.

    Postures have rows of their own, since there the lesion's place itself is asked for. Also says
    how many samples of which view were lost.
    """
    shifts: dict[str, NDArray[np.float64]] = {}
    biopsy_shifts: dict[str, NDArray[np.float64]] = {}
    postures: dict[str, NDArray[np.float64]] = {}
    done: dict[int, NDArray[np.float64]] = {}
    notes: list[str] = []
    for folder, position in at_mammogram.items():
        on_progress(folder, "uncertainty", None)
        label, watch = position.compressed.view.label, partial(on_progress, folder)
        shifts[label], lost = _sampled(origins, position, folder, config, watch)
        notes += lost
        if folder in at_biopsy:
            held = at_biopsy[folder]
            key = id(held.compressed)
            if key not in done:
                what = f"biopsy {held.compressed.view.folder}"
                done[key], lost = _sampled(origins, held, what, config, watch)
                notes += lost
            biopsy_shifts[label] = done[key]
            if held.compressed.posture is not None:
                postures[f"{label} {held.compressed.posture}"] = done[key]
    spread = uncertainties(origins, shifts, biopsy_shifts if at_biopsy else None)
    return spread + uncertainties(origins, postures), notes


def _sampled(
    origins: Sequence[UncompressedTarget],
    held: _Position,
    what: str,
    config: RunConfig,
    on_progress: Callable[[str, np.void], None],
) -> tuple[NDArray[np.float64], list[str]]:
    """Shift of each target in each sample of one position, [sample, target, 3], mm; and notes."""
    settings = config.targets.uncertainty or UncertaintySettings()
    if not held.compressed.is_compressed and held.compressed.posture is None:  # nothing varies
        still = np.array([mean_shift_mm(held.compressed.field, origin) for origin in origins])
        return np.broadcast_to(still, (settings.samples, *still.shape)), []
    sampler = Sampler(held.compressed, held.settings)
    ratio = held.settings.fibres.ratio if sampler.has_fibres else None
    samples = draw_samples(settings, sampler.groups, what, config.seed, ratio)

    def watch(number: int, row: np.void) -> None:
        on_progress(f"uncertainty, sample {number + 1} of {len(samples)}", row)

    found = sampled_shifts(sampler, origins, samples, watch)
    lost = np.flatnonzero(np.isnan(found).any(axis=(1, 2)))
    return found, [_left_out(what, samples, lost.tolist())] if lost.size else []


def _left_out(what: str, samples: Sequence[Sample], lost: Sequence[int]) -> str:
    """One sentence that counts the samples without equilibrium and names them."""
    named = "; ".join(f"{number + 1} ({samples[number]})" for number in lost[:MAX_NAMED])
    more = f"; and {len(lost) - MAX_NAMED} more" if len(lost) > MAX_NAMED else ""
    return (
        f"{what}: {len(lost)} of {len(samples)} samples did not converge and were omitted: "
        f"{named}{more}"
    )

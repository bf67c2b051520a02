"""The order of slices along their normal: none missing, none there twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import OBLIQUE_LIMIT_DEG

UNEVEN = 0.02
"""Of the distance of slices: more than rounding in a header (16 characters a number) explains."""

MAX_SHOWN = 5
"""Gaps and pairs named in a message."""


@dataclass(frozen=True)
class SliceOrder:
    """Slices in order.

    Parameters
    ----------
    index : tuple of int
        Numbers of the slices as they were given, lowest first.
    step_mm : float or None
        Distance of neighbours, mm, where it is known.
    by_position : bool
        Whether their positions gave the order.
    """

    index: tuple[int, ...]
    step_mm: float | None
    by_position: bool


def by_position(
    positions_mm: NDArray[np.float64],
    normal: NDArray[np.float64],
    names: Sequence[str],
    thickness_mm: float | None,
    path: Path,
) -> SliceOrder:
    """Order slices by where they are.

    Parameters
    ----------
    positions_mm : ndarray, (n, 3)
        First pixel of each slice, mm.
    normal : ndarray, (3,)
        Unit vector at right angles to the slices.
    names : sequence of str
        For messages.
    thickness_mm : float or None
        Distance of slices where there is only one.
    path : path
        For messages.

    Raises
    ------
    InputError
        If a slice is missing or there twice, distances are uneven, or the stack is oblique.
    """
    if not np.isfinite(positions_mm).all():
        raise InputError(f"{path}: ImagePositionPatient holds numbers that are not finite")
    if len(positions_mm) == 1:
        return SliceOrder((0,), thickness_mm, True)
    along = positions_mm @ normal
    index = np.argsort(along, kind="stable")
    gaps = np.diff(along[index])
    step = float(np.median(gaps[gaps > 0])) if (gaps > 0).any() else 0.0
    _check_even(gaps, step, [names[number] for number in index], path)
    drift = positions_mm[index[-1]] - positions_mm[index[0]]
    if (
        np.linalg.norm(drift) * np.cos(np.deg2rad(OBLIQUE_LIMIT_DEG))
        > along[index[-1]] - along[index[0]]
    ):
        raise InputError(
            f"{path}: its slices are shifted relative to each other (by {drift.round(2).tolist()} "
            f"mm "
            "from first to last), expected a straight stack; resample it first"
        )
    return SliceOrder(tuple(int(number) for number in index), step, True)


def _check_even(gaps: NDArray[np.float64], step: float, names: Sequence[str], path: Path) -> None:
    twice = np.flatnonzero(gaps < 0.5 * step) if step else np.arange(len(gaps))
    wide = np.flatnonzero(gaps > 1.5 * step) if step else np.empty(0, int)
    problems = [
        f"{path}: {names[n]} and {names[n + 1]} lie {gaps[n]:.4g} mm apart, others {step:.4g} mm: "
        "a slice is there twice"
        for n in twice[:MAX_SHOWN]
    ]
    problems += [
        f"{path}: {names[n]} and {names[n + 1]} lie {gaps[n]:.4g} mm apart, others {step:.4g} mm: "
        f"{max(round(gaps[n] / step) - 1, 1)} missing between them"
        for n in wide[:MAX_SHOWN]
    ]
    if not problems and (np.abs(gaps - step) > UNEVEN * step).any():
        problems.append(
            f"{path}: its slices lie {gaps.min():.4g} to {gaps.max():.4g} mm apart, expected equal "
            "distances; resample it first"
        )
    if problems:
        raise InputError(problems)


def by_number(
    numbers: Sequence[int | None], names: Sequence[str], thickness_mm: float | None, path: Path
) -> SliceOrder:
    """Order slices by their InstanceNumber.

    Parameters
    ----------
    numbers : sequence of int or None
    names : sequence of str
        For messages.
    thickness_mm : float or None
        Distance of slices, where the header says.
    path : path
        For messages.

    Raises
    ------
    InputError
        If a number is missing or there twice.
    """
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        nameless = names[list(numbers).index(None)]
        raise InputError(
            f"{path}: {nameless} has neither ImagePositionPatient nor InstanceNumber, so the "
            f"order of slices is not known"
        )
    index = sorted(range(len(known)), key=known.__getitem__)
    problems = []
    for before, after in pairwise(index):
        gap = known[after] - known[before]
        if gap == 0:
            problems.append(
                f"{path}: {names[before]} and {names[after]} both have InstanceNumber "
                f"{known[after]}: a slice is there twice"
            )
        elif gap > 1:
            problems.append(
                f"{path}: InstanceNumber {known[before]} is followed by {known[after]}: "
                f"{gap - 1} missing between them"
            )
    if problems:
        raise InputError(problems[:MAX_SHOWN])
    return SliceOrder(tuple(index), thickness_mm, False)

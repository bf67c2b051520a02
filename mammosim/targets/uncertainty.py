"""How sure a shift is: the same compression with what is not known exactly drawn at random."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import Sample, Sampler
from mammosim.targets.biopsy import miss_mm
from mammosim.targets.ellipsoid import Ellipsoid, prediction_ellipsoid, quantile
from mammosim.targets.origins import UncompressedTarget, mean_shift_mm
from mammosim.targets.settings import UncertaintySettings

STREAM = 0x5117
"""Keeps these numbers apart from others that are drawn with the run's seed."""

MIN_SAMPLES = 5
"""Fewer cannot give an ellipsoid."""


@dataclass(frozen=True)
class ShiftUncertainty:
    """One row of `uncertainty.csv`: one target in one view.

    The fields are the table's columns; lengths in mm, vectors in the breast frame. `shift_...` is
    the samples' mean; `cov_...` their covariance, mm2; `long_...`, `middle_...`, `short_...` the
    semi-axes of the 95 % ellipsoid around the mean with their directions. `miss_...` is of the
    needle aimed at the target's mammographic place; NaN without a biopsy.
    """

    target_id: int
    name: str
    kind: str
    view: str
    samples: int
    shift_x_mm: float
    shift_y_mm: float
    shift_z_mm: float
    cov_xx_mm2: float
    cov_xy_mm2: float
    cov_xz_mm2: float
    cov_yy_mm2: float
    cov_yz_mm2: float
    cov_zz_mm2: float
    long_mm: float
    long_x: float
    long_y: float
    long_z: float
    middle_mm: float
    middle_x: float
    middle_y: float
    middle_z: float
    short_mm: float
    short_x: float
    short_y: float
    short_z: float
    miss_mean_mm: float = math.nan
    miss_sd_mm: float = math.nan
    miss_95_mm: float = math.nan
    miss_long_mm: float = math.nan
    miss_middle_mm: float = math.nan
    miss_short_mm: float = math.nan


def draw_samples(
    settings: UncertaintySettings,
    groups: Sequence[str],
    position: str,
    seed: int,
    fibre_ratio: float | None = None,
) -> list[Sample]:
    """Deviations of one position of the breast.

    Parameters
    ----------
    settings : UncertaintySettings
    groups : sequence of str
        Groups of tissues that the breast has.
    position : str
        Name of the position, as `LCC`: plates are drawn anew for each, while stiffness and lattice
        of a sample are the same in all of them, since it is the same breast.
    seed : int
    fibre_ratio : float, optional
        Ratio of fibres in the compression that is varied; None where the model knows none.

    Returns
    -------
    list of Sample
        The same for the same arguments, whatever other positions there are.
    """
    count = settings.samples
    of_breast = np.random.default_rng([seed, STREAM])
    logs = of_breast.standard_normal((count, len(groups))) * settings.stiffness_spread
    lattices = of_breast.integers(1 << 16, size=count)
    ratios = _fibre_ratios(settings, fibre_ratio, of_breast.random(count))
    of_position = np.random.default_rng([seed, STREAM, zlib.crc32(position.encode())])
    reach = (settings.thickness_mm, settings.plate_height_mm, settings.plate_edge_mm)
    plates = of_position.uniform(-1.0, 1.0, (count, 3)) * reach
    return [
        Sample(
            dict(zip(groups, np.exp(logs[n]).tolist(), strict=True)),
            thickness_mm=float(plates[n, 0]),
            height_mm=float(plates[n, 1]),
            edge_mm=float(plates[n, 2]),
            lattice=int(lattices[n]) if settings.lattice else 0,
            fibre_ratio=ratios[n],
        )
        for n in range(count)
    ]


def _fibre_ratios(
    settings: UncertaintySettings, nominal: float | None, part: NDArray[np.float64]
) -> list[float | None]:
    """Ratio of fibres of each sample, from even numbers between 0 and 1."""
    if nominal is None or settings.fibre_ratio == 1.0:
        return [None] * len(part)
    highest = max(settings.fibre_ratio, 2.0 * nominal - 1.0)
    return [float(ratio) for ratio in 1.0 + part * (highest - 1.0)]


def sampled_shifts(
    sampler: Sampler,
    origins: Sequence[UncompressedTarget],
    samples: Sequence[Sample],
    watch: Callable[[int, np.void], None] | None = None,
) -> NDArray[np.float64]:
    """Shift of each target in each sample of the uncertain inputs.

    Parameters
    ----------
    sampler : Sampler
        Compresses the breast with a sample's stiffness, plates and lattice.
    origins : sequence of UncompressedTarget
    samples : sequence of Sample
    watch : callable, optional
        Is called with each sample's number and each row of its history.

    Returns
    -------
    ndarray, [sample, target, 3]
        Breast frame, mm; NaN where the solver did not reach its tolerance.
    """
    shifts = np.full((len(samples), len(origins), 3), np.nan)
    for number, sample in enumerate(samples):
        field = sampler.field(sample, partial(watch, number) if watch else None)
        if field is not None:
            shifts[number] = [mean_shift_mm(field, origin) for origin in origins]
    return shifts


def uncertainties(
    origins: Sequence[UncompressedTarget],
    seen: Mapping[str, NDArray[np.float64]],
    then: Mapping[str, NDArray[np.float64]] | None = None,
) -> list[ShiftUncertainty]:
    """Spread of each target's shift in each view, and of the needle's miss.

    Parameters
    ----------
    origins : sequence of UncompressedTarget
        Targets, the nipple last.
    seen : mapping of str to ndarray, [sample, target, 3]
        Shifts in each view, by the view's name.
    then : mapping of str to ndarray, [sample, target, 3], optional
        Shifts in the biopsy position that belongs to each view, of the same samples.

    Returns
    -------
    list of ShiftUncertainty
        Views without enough samples are left out.
    """
    rows = []
    for view, shifts in seen.items():
        biopsy = None if then is None else then[view]
        for number, origin in enumerate(origins):
            known = np.isfinite(shifts[:, number]).all(axis=1)
            if np.count_nonzero(known) < MIN_SAMPLES:
                continue
            found = prediction_ellipsoid(shifts[known, number])
            rows.append(
                ShiftUncertainty(
                    number + 1, origin.name, origin.kind, view, int(known.sum()),
                    **_columns(found), **_missed(shifts, biopsy, number, origin),
                )
            )  # fmt: skip
    return rows


def _columns(found: Ellipsoid) -> dict[str, float]:
    columns = {f"shift_{axis}_mm": float(found.mean_mm[n]) for n, axis in enumerate("xyz")}
    for n, one in enumerate("xyz"):
        for m, other in enumerate("xyz"):
            if m >= n:
                columns[f"cov_{one}{other}_mm2"] = float(found.covariance_mm2[n, m])
    for n, name in enumerate(("long", "middle", "short")):
        columns[f"{name}_mm"] = float(found.semi_axes_mm[n])
        for m, axis in enumerate("xyz"):
            columns[f"{name}_{axis}"] = float(found.directions[n, m])
    return columns


def _missed(
    shifts: NDArray[np.float64],
    biopsy: NDArray[np.float64] | None,
    number: int,
    origin: UncompressedTarget,
) -> dict[str, Any]:
    """Length of the miss over the samples that both positions have, and its ellipsoid."""
    if biopsy is None or origin.kind == "nipple":
        return {}
    misses = miss_mm(shifts[:, number], shifts[:, -1], biopsy[:, number], biopsy[:, -1])
    misses = misses[np.isfinite(misses).all(axis=1)]
    if len(misses) < MIN_SAMPLES:
        return {}
    lengths = np.linalg.norm(misses, axis=1)
    axes = prediction_ellipsoid(misses).semi_axes_mm
    return {
        "miss_mean_mm": float(lengths.mean()),
        "miss_sd_mm": float(lengths.std(ddof=1)),
        "miss_95_mm": quantile(lengths),
        "miss_long_mm": float(axes[0]),
        "miss_middle_mm": float(axes[1]),
        "miss_short_mm": float(axes[2]),
    }

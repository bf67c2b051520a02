"""Limits beyond which a result is doubtful, or is no result: one table for every room."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

_MQSA = (
    "21 CFR 900.12(e)(4)(iii): the initial power drive of a mammography unit reaches a maximum "
    "compression force between 111 and 200 N"
)
LOW_FORCE_N = 20.0
"""Force on the paddle below which it hardly compresses, N. Assumed: the least of 560 women had 49 N
(Sullivan et al. 1991)."""

_CONTRACT = "assumed: the largest loss of the published cases of this model is 14 %"


@dataclass(frozen=True)
class Limit:
    """What is plausible of one quantity.

    Parameters
    ----------
    quantity : str
        Key of the quantity; its ending says its unit.
    name, unit : str
        As printed.
    low, high : float
        Outside of this range the result is doubtful; infinite where there is no limit.
    error_above : float
        Above this there is no result.
    advice : str
        What usually causes it, or what to try.
    source : str
        Where the limits come from, or why they were assumed.
    """

    quantity: str
    name: str
    unit: str
    low: float
    high: float
    error_above: float
    advice: str
    source: str


LIMITS: tuple[Limit, ...] = (
    Limit(
        "paddle_force_n", "force on the paddle", "N", LOW_FORCE_N, 200.0, 2000.0,
        "check thickness, stiffness and the plates' edge; of a clinical force, the breast bears "
        "22 % in CC and 14 % in MLO, and the tissue at the chest wall, which plates in front of "
        "it do not reach, the rest",
        "the parts: 28 women under sensors (Dustler et al. 2021, Acta Radiol 62:1583). "
        f"High: {_MQSA}. Low and error: assumed; 49 to 186 N were measured in 560 women "
        "(Sullivan et al. 1991, Radiology 181:355)",
    ),
    Limit(
        "usual_force_n", "force on the paddle at a usual thickness", "N", 7.0, 200.0, 2000.0,
        "check stiffness and the plates' edge",
        "low: the least of 49 to 186 N (560 women: Sullivan et al. 1991, Radiology 181:355) times "
        "the 14 % that bear on the breast itself in MLO (28 women: Dustler et al. 2021, Acta "
        "Radiol 62:1583); plates in front of the chest wall miss the rest",
    ),
    Limit(
        "mean_pressure_kpa", "mean pressure under the paddle", "kPa", -math.inf, 40.0, math.inf,
        "check thickness, stiffness and the plates' edge",
        "assumed: mean plus 1.6 standard deviations in CC under 18 daN, 21.3 and 11.5 kPa "
        "(de Groot et al. 2013, Med Phys 40:081901)",
    ),
    Limit(
        "force_imbalance_percent", "difference between the forces on paddle and support", "%",
        -math.inf, 5.0, 50.0,
        "the chest wall carries the rest; check the plates' heights (default: balanced) and the "
        "solver's tolerance",
        "assumed: without gravity the two forces differ only by what the chest wall carries, "
        "which nobody measures; a technologist levels the support with the breast",
    ),
    Limit(
        "springs_volume_loss_percent", "loss of volume", "%", -math.inf, 3.0, 20.0,
        "springs do not conserve volume under strong compression; compression.model: hyperelastic "
        "does",
        _CONTRACT,
    ),
    Limit(
        "springs_folded_percent", "share of folded cells", "%", -math.inf, 0.1, 2.0,
        "springs fold beside the plates' edge under strong compression, and more so on finer "
        "lattices; compression.model: hyperelastic does not",
        _CONTRACT,
    ),
    Limit(
        "folded_elements", "number of folded elements", "", -math.inf, 0.0, 0.0,
        "no solid can fold: compress less, or use larger elements",
        "a folded element has a negative volume",
    ),
    Limit(
        "stiffness_ratio", "stiffness of gland relative to fat, or of fat to gland", "", 1.0,
        300.0, math.inf,
        "the softer of the two folds where plates press it; set compression.stiffness_kpa of both "
        "nearer to each other",
        "elements of 6 mm, a generated breast of 550 mL in CC and MLO: equilibria at 304, with a "
        "smallest J of 0.013 and 0.008; folded in CC at 1013",
    ),
    Limit(
        "breast_volume_ml", "volume of the breast", "mL", -math.inf, 4000.0, math.inf,
        "check the phantom's voxel size (phantom.voxel_mm)",
        "assumed: 150 to 1490 mL were removed in 30 mastectomies (Kayar et al. 2011, Breast Cancer "
        "(Auckl) 5:43); a voxel size that is ten times too large gives a thousand times as much",
    ),
    Limit(
        "compressed_thickness_mm", "compressed thickness", "mm", 10.0, 120.0, math.inf,
        "check compression.thickness_mm and the phantom's voxel size",
        "assumed: 24 to 79 mm hold 95 % of 82 mammograms (Boone et al. 2000, Med Phys 27:2408)",
    ),
    Limit(
        "lesion_in_image_percent", "part of the lesion in the image", "%", 99.0, 100.0, math.inf,
        "the rest lies behind the chest-wall edge of the detector or beside it, where no needle "
        "can be aimed; move the lesion (position_mm), the plates (compression.plate_edge_mm) or "
        "the detector (projection.detector_edge_mm, projection.detector_mm)",
        "assumed: what the edge of the image cuts off is missing from the lesion's mask, place and "
        "size on it; 1 % allows for single voxels",
    ),
    Limit(
        "tube_load_mas", "tube load", "mAs", 1.0, 600.0, math.inf,
        "no unit makes such an exposure; check acquisition.mas, kvp and the thickness",
        "assumed: the largest setting of clinical units is near 600 mAs",
    ),
    Limit(
        "magnified_focal_spot_mm", "focal spot of a magnified view", "mm", -math.inf, 0.15,
        math.inf,
        "magnified views are taken with the small focal spot (acquisition.focal_spot_mm: 0.1), "
        "otherwise the blur grows with the magnification",
        "IEC 60336: a nominal spot of 0.1 mm measures up to 0.15 mm; larger ones blur what is "
        "magnified as in practice (Koutalonis et al. 2008, doi 10.1088/0031-9155/53/5/013)",
    ),
    Limit(
        "dose_percent_of_limit", "mean glandular dose relative to the guideline's limit for this "
        "thickness", "%", -math.inf, 100.0, math.inf,
        "check acquisition.mas and the beam",
        "European guidelines for quality assurance in breast cancer screening and diagnosis, "
        "4th edition (2006): acceptable level over thickness",
    ),
    Limit(
        "unknown_dose_angle_deg", "tube angle at which t, the dose over that of the upright tube, "
        "is taken as 1", "degrees", -math.inf, 0.0, math.inf,
        "only acquisition.scatter.model: monte-carlo computes t; the dose of all projections is "
        "an estimate, some per cent too high for a wide arc",
        "t is the dose at an angle over that of the upright tube for the same load (Dance, Young "
        "and van Engen 2011, Phys Med Biol 56:453); it is 1 by definition at 0 degrees alone",
    ),
    Limit(
        "scatter_to_primary_ratio", "scatter-to-primary ratio in front of the grid", "", 0.1, 1.5,
        math.inf, "check the thickness and acquisition.scatter",
        "0.40 to 0.85 were measured (Barnes and Brezovich 1978, Radiology 126:243); the wider "
        "range allows for 1 to 12 cm and is assumed",
    ),
    Limit(
        "saturated_percent", "share of saturated pixels in the breast", "%", -math.inf, 1.0,
        math.inf, "the detector's range is exceeded; check acquisition.mas",
        "assumed",
    ),
    Limit(
        "uniform_pixels_percent", "share of pixels in the breast with the same value", "%",
        -math.inf, 50.0, math.inf, "the image shows nothing; check acquisition.mas and the beam",
        "assumed",
    ),
)  # fmt: skip
"""Every limit that is checked."""

_BY_QUANTITY = {limit.quantity: limit for limit in LIMITS}


FOUND = ": found"
"""Between the name of a limit and what is beyond it, in every message."""


def patients_beyond(warnings: Mapping[int, Iterable[str]]) -> dict[str, int]:
    """How many patients have a warning by each limit, and by none of them ('other').

    Parameters
    ----------
    warnings : mapping of int to iterable of str
        Warnings of each patient.

    Examples
    --------
    >>> patients_beyond({3: ["LCC: tube load: found 900 mAs, ..."], 5: ["a side was guessed"]})
    {'tube load': 1, 'other': 1}
    """
    counts = dict.fromkeys([*(limit.name for limit in LIMITS), "other"], 0)
    for texts in warnings.values():
        of_patient = {
            next((limit.name for limit in LIMITS if limit.name + FOUND in text), "other")
            for text in texts
        }
        for name in of_patient:
            counts[name] += 1
    return {name: count for name, count in counts.items() if count}


def limit_of(quantity: str) -> Limit:
    """The limit of a quantity.

    Examples
    --------
    >>> limit_of("tube_load_mas").high
    600.0
    """
    return _BY_QUANTITY[quantity]


@dataclass(frozen=True)
class PlausibilityWarning:
    """A quantity outside its plausible range.

    Parameters
    ----------
    limit : Limit
    value : float
    severity : {"warning", "error"}
        Whether the result is doubtful, or is none.
    """

    limit: Limit
    value: float
    severity: Literal["warning", "error"]

    def __str__(self) -> str:
        limit, unit = self.limit, f" {self.limit.unit}" if self.limit.unit else ""
        if not math.isfinite(self.value):
            return f"{limit.name}{FOUND} {self.value}, expected a number; {limit.advice}"
        if self.severity == "error":
            allowed = f"no result above {limit.error_above:g}{unit}"
        elif self.value < limit.low:
            allowed = f"plausible from {limit.low:g}{unit}"
        else:
            allowed = f"plausible up to {limit.high:g}{unit}"
        return f"{limit.name}{FOUND} {self.value:.4g}{unit}, {allowed}; {limit.advice}"


def plausibility_warnings(quantities: Mapping[str, float]) -> tuple[PlausibilityWarning, ...]:
    """Quantities outside their plausible range, in the table's order.

    Parameters
    ----------
    quantities : mapping of str to float
        Values by a limit's `quantity`. Those left out are not judged.

    Returns
    -------
    tuple of PlausibilityWarning

    Raises
    ------
    KeyError
        If there is no limit of that name.

    Examples
    --------
    >>> [str(warning) for warning in plausibility_warnings({"tube_load_mas": 1172.0})]
    ['tube load: found 1172 mAs, plausible up to 600 mAs; no unit makes such an exposure; check \
acquisition.mas, kvp and the thickness']
    >>> plausibility_warnings({"paddle_force_n": 122.0})
    ()
    """
    unknown = set(quantities) - set(_BY_QUANTITY)
    if unknown:
        raise KeyError(f"no plausibility limit for {', '.join(sorted(unknown))}")
    found = []
    for limit in LIMITS:
        if limit.quantity not in quantities:
            continue
        value = float(quantities[limit.quantity])
        if not value <= limit.error_above:
            found.append(PlausibilityWarning(limit, value, "error"))
        elif not limit.low <= value <= limit.high:
            found.append(PlausibilityWarning(limit, value, "warning"))
    return tuple(found)

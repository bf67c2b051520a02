"""Whether a compressed breast can be believed: its numbers against the table of limits."""

from __future__ import annotations

import math

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.settings import CompressionSettings
from mammosim.plausibility import Doubt, doubts


def compression_doubts(
    compressed: CompressedBreast, settings: CompressionSettings
) -> tuple[Doubt, ...]:
    """Numbers of a compression outside their plausible range.

    Parameters
    ----------
    compressed : CompressedBreast
    settings : CompressionSettings
        A low force is plausible where a force was asked for; forces need not balance under gravity.

    Returns
    -------
    tuple of Doubt
    """
    quantities = {"compressed_thickness_mm": compressed.thickness_mm}
    if compressed.model != "none":
        quantities |= _contact(compressed, settings) | _deformation(compressed)
    return doubts(quantities)


def _contact(compressed: CompressedBreast, settings: CompressionSettings) -> dict[str, float]:
    measures = compressed.measures
    paddle_n, support_n = measures["force_n"], measures["support_force_n"]
    asked_for = settings.force_n is not None
    quantities = {"mean_pressure_kpa": measures["pressure_kpa"]}
    if not (asked_for and paddle_n < 20.0):
        quantities["paddle_force_n"] = paddle_n
    largest = max(paddle_n, support_n)
    if not settings.gravity and largest > 0.0:
        quantities["force_imbalance_percent"] = 100.0 * abs(paddle_n - support_n) / largest
    return quantities


def _deformation(compressed: CompressedBreast) -> dict[str, float]:
    measures = compressed.measures
    folded = measures["inverted_cells"]
    if compressed.model == "hyperelastic":
        return {"folded_elements": folded}
    return {
        "springs_volume_loss_percent": measures["volume_change_percent"],
        "springs_folded_percent": 100.0 * folded / max(measures["cells"], 1.0)
        if math.isfinite(folded)
        else math.nan,
    }

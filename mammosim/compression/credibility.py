"""Whether a compressed breast can be believed: its numbers against the table of limits."""

from __future__ import annotations

from dataclasses import replace

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.lattice import breast_volume_ml
from mammosim.compression.model import MODELS
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import NotConverged
from mammosim.plausibility import LOW_FORCE_N, plausibility_warnings


def believed(compressed: CompressedBreast, settings: CompressionSettings) -> CompressedBreast:
    """A converged compression with its plausibility_warnings among its notes.

    Parameters
    ----------
    compressed : CompressedBreast
    settings : CompressionSettings

    Returns
    -------
    CompressedBreast

    Raises
    ------
    NotConverged
        If a number lies beyond what any result may have; it carries the breast, marked as not
        converged.
    """
    model = MODELS[compressed.model]
    quantities = {
        "breast_volume_ml": breast_volume_ml(compressed.phantom),
        "compressed_thickness_mm": compressed.thickness_mm,
        **model.quantities(compressed, settings),
    }
    found = plausibility_warnings(quantities)
    folder = compressed.view.folder
    noted = tuple(f"{folder}: {warning}" for warning in found)
    compressed = replace(compressed, notes=(*compressed.notes, *noted))
    refused = [str(warning) for warning in found if warning.severity == "error"]
    if refused:
        reason = "; ".join(refused)
        raise NotConverged(
            f"{folder}: no credible result: {reason}",
            replace(compressed, converged=False),
        )
    return compressed


def contact_quantities(
    compressed: CompressedBreast, settings: CompressionSettings
) -> dict[str, float]:
    """Force and pressure of the plates, for the table of limits.

    A low force is plausible where a force was asked for. Where neither that nor a thickness or
    heights were, the thickness is a population's, and the force need only be a breast's own share
    of a clinical one. The forces on paddle and support need not balance under gravity.
    """
    measures = compressed.measures
    paddle_n, support_n = measures["force_n"], measures["support_force_n"]
    quantities = {"mean_pressure_kpa": measures["pressure_kpa"]}
    usual = settings.thickness_mm is None and settings.support_z_mm is None
    if paddle_n >= LOW_FORCE_N or not usual:
        quantities["paddle_force_n"] = paddle_n
    elif settings.force_n is None:
        quantities["usual_force_n"] = paddle_n
    largest = max(paddle_n, support_n)
    if not settings.gravity and largest > 0.0:
        quantities["force_imbalance_percent"] = 100.0 * abs(paddle_n - support_n) / largest
    return quantities

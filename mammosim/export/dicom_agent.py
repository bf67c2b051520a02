"""DICOM attributes of images that were taken with a contrast agent."""

from __future__ import annotations

from typing import Any


def contrast_agent(energy: str, raw: bool) -> dict[str, Any]:
    """Contrast/Bolus, and Image Type of an exposure (PS3.3, tables C.8-74d and C.8-74e).

    Parameters
    ----------
    energy : {"LOW_ENERGY", "HIGH_ENERGY"}
    raw : bool
        Whether its pixels are as they were recorded.
    """
    return {
        "ImageType": ["ORIGINAL" if raw else "DERIVED", "PRIMARY", "", "", energy],
        "ContrastBolusAgent": "Iodine, simulated",
        "ContrastBolusIngredient": "IODINE",
    }

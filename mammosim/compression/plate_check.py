"""Whether a breast can be compressed as the settings say, before it is."""

from __future__ import annotations

from dataclasses import replace

from mammosim.compression.breast_elements import skin_of
from mammosim.compression.compress import view_of_compressed
from mammosim.compression.lattice import Lattice, build_lattice
from mammosim.compression.model import MODELS
from mammosim.compression.plates import (
    heights_beyond_edge_mm,
    held_tissue,
    place_plates,
    plate_edge_mm,
)
from mammosim.compression.plates.paddle import covered_tissue, panel_of
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.thesis_units import in_millimetres
from mammosim.compression.uncompressed import refuse_moving
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held


def check_plates(
    breast: BreastPhantom, view: View, settings: CompressionSettings, slack_mm: float = 0.0
) -> None:
    """Refuse what `compress` would refuse once it has a lattice.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    settings : CompressionSettings
    slack_mm : float
        By how much the breast may be larger than this phantom, which is an outline of it, mm.

    Raises
    ------
    InputError
        If the breast was compressed for another view, a lesion lies where this view does not hold
        the breast, the plates would not touch it, or skin is described that it does not have.
    """
    view = view_of_compressed(breast, view)
    held = as_held(breast, view.rotation[1])
    if not MODELS[settings.model].compresses:
        refuse_moving(settings)
        return
    skin_of(held, settings)
    settings = in_millimetres(settings, held, view)
    reach, muscle_fixed = held_tissue(settings, held)
    resolution_mm = max(settings.resolution_mm, 0.5 * slack_mm)
    lattice = build_lattice(held, view, resolution_mm, settings.moduli)
    edge = plate_edge_mm(settings, reach, muscle_fixed)
    _check_paddle(settings, lattice, edge, view, slack_mm)
    if slack_mm and _may_fit(lattice, settings.thickness_mm, edge, slack_mm):
        return
    place_plates(settings, held, view, lattice, edge)


def _check_paddle(
    settings: CompressionSettings, lattice: Lattice, edge_mm: float, view: View, slack_mm: float
) -> None:
    """Refuse a paddle beside a breast that may be larger by the slack."""
    panel = panel_of(settings.paddle, edge_mm)
    if panel is None:
        return
    grown = replace(
        panel, front_mm=panel.front_mm + slack_mm, low_mm=panel.low_mm - slack_mm,
        high_mm=panel.high_mm + slack_mm,
    )  # fmt: skip
    try:
        covered_tissue(lattice, edge_mm, grown, view)
    except InputError:
        covered_tissue(lattice, edge_mm, panel, view)  # says the paddle's own place


def _may_fit(lattice: Lattice, thickness_mm: float | None, edge_mm: float, slack_mm: float) -> bool:
    """Whether plates can touch a breast that is larger by up to the slack."""
    if edge_mm - slack_mm >= lattice.front_mm:
        return False
    low, high = heights_beyond_edge_mm(lattice, edge_mm - slack_mm)
    return thickness_mm is None or thickness_mm < high - low + slack_mm

"""Where paddle and breast support go: their faces and their edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.lattice import (
    MUSCLE_REACH_MM,
    Lattice,
    PosteriorLimits,
    breast_volume_ml,
    posterior_limits,
)
from mammosim.compression.plates.paddle import covered_tissue, panel_of, tissue_beyond_edge
from mammosim.compression.plates.solids import Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom

EDGE_BEFORE_WALL_MM = 5.0
"""Plates' edge in front of the chest wall or fixed muscle, mm: tissue needs room to bend there."""

MAX_OF_HEIGHT = 0.8
"""A thickness from the population fit is at most this part of the breast's own height."""


def population_thickness_mm(view: str, volume_ml: float) -> float:
    """Compressed thickness of a population's breasts of a volume.

    Parameters
    ----------
    view : str
        ``CC``; any other is taken as MLO.
    volume_ml : float
        Volume of the breast, mL.

    Returns
    -------
    float
        Thickness, mm.

    Notes
    -----
    CC 0.60 V / (0.073 V + 36.01) + 0.70 cm, with a standard deviation of 9 %; MLO (also taken for
    ML) 0.66 V / (0.064 V + 74.53) + 1.58 cm; V in cm3 (M-PACT). It says nothing of one breast:
    stiffness, age and the force that a woman bears are not in it.

    Examples
    --------
    >>> round(population_thickness_mm("CC", 600.0))
    52
    """
    if view == "CC":
        return 10.0 * (0.60 * volume_ml / (0.073 * volume_ml + 36.01) + 0.70)
    return 10.0 * (0.66 * volume_ml / (0.064 * volume_ml + 74.53) + 1.58)


def held_tissue(
    settings: CompressionSettings, breast: BreastPhantom
) -> tuple[PosteriorLimits, bool]:
    """How far chest wall and muscle reach, and whether labelled muscle is held.

    Parameters
    ----------
    settings : CompressionSettings
        `chest_wall_mm` and `muscle` win over what the voxels show.
    breast : BreastPhantom

    Returns
    -------
    reach : PosteriorLimits
        Breast-frame x of the faces of chest wall and muscle, mm.
    muscle_fixed : bool
        As the settings say; where they are silent, muscle is held if it reaches at most
        `MUSCLE_REACH_MM` in front of the chest wall.
    """
    reach = posterior_limits(breast)
    if settings.chest_wall_mm is not None:
        reach = replace(reach, chest_wall_mm=settings.chest_wall_mm)
    if settings.muscle is not None:
        return reach, settings.muscle == "fixed"
    return reach, reach.muscle_mm - reach.chest_wall_mm <= MUSCLE_REACH_MM


def plate_edge_mm(
    settings: CompressionSettings, reach: PosteriorLimits, muscle_fixed: bool
) -> float:
    """Where the plates end towards the chest wall.

    Parameters
    ----------
    settings : CompressionSettings
        Its `plate_edge_mm` is used where it is given.
    reach : PosteriorLimits
        How far chest wall and muscle reach to the front, breast frame, mm.
    muscle_fixed : bool
        Whether the muscle is held as the chest wall is; the plates then stop in front of it.

    Returns
    -------
    float
        Breast-frame x of the edge, mm; by default `EDGE_BEFORE_WALL_MM` in front of what is held.
    """
    if settings.plate_edge_mm is not None:
        return settings.plate_edge_mm
    front = max(reach.chest_wall_mm, reach.muscle_mm) if muscle_fixed else reach.chest_wall_mm
    return front + EDGE_BEFORE_WALL_MM


def place_plates(
    settings: CompressionSettings,
    breast: BreastPhantom,
    view: View,
    lattice: Lattice,
    edge_mm: float,
) -> tuple[Plates, tuple[str, ...]]:
    """Place of the plates and what was assumed.

    Parameters
    ----------
    settings : CompressionSettings
    breast : BreastPhantom
    view : View
    lattice : Lattice
        Of the breast in this view.
    edge_mm : float
        Breast-frame x of the plates' edge, mm.

    Raises
    ------
    InputError
        If the plates would not touch the breast, or no tissue lies beyond their edge.

    Notes
    -----
    Where the settings give no heights, the search for the height at which both plates press alike
    (`plate_balance`) starts here: from the middle of all tissue or, where a breast has a way to the
    axilla, which stands higher than the breast, from the breast's own height.
    """
    front = lattice.front_mm
    if front <= edge_mm:
        raise InputError(
            f"compression.plate_edge_mm: found {edge_mm:g}, but tissue extends only to "
            f"x = {front:g} mm; must be smaller"
        )
    panel = panel_of(settings.paddle, edge_mm)
    covered = covered_tissue(lattice, edge_mm, panel, view)
    notes: tuple[str, ...] = ()
    if settings.support_z_mm is not None and settings.paddle_z_mm is not None:
        _check_heights(settings.support_z_mm, settings.paddle_z_mm, lattice, edge_mm, view)
        plates = Plates(settings.support_z_mm, settings.paddle_z_mm, edge_mm)
    else:
        low, high = heights_mm(lattice, covered)
        thickness, notes = _thickness_mm(settings, breast, view, high - low)
        middle = 0.5 * sum(lattice.height_mm)
        if breast.open_end is not None:
            middle = forward_height_mm(lattice, edge_mm)
        plates = Plates(middle - 0.5 * thickness, middle + 0.5 * thickness, edge_mm)
    return (plates.shaped("panel", panel) if panel else plates), notes


def _thickness_mm(
    settings: CompressionSettings, breast: BreastPhantom, view: View, height_mm: float
) -> tuple[float, tuple[str, ...]]:
    """Thickness that the settings give or, if they give none, a population's; and what was assumed.

    Where a force is searched for, it is only the start, and nothing is assumed.
    """
    thickness = settings.thickness_mm
    if thickness is not None:
        if thickness >= height_mm:
            raise InputError(
                f"compression.thickness_mm: found {thickness:g}, but the breast between the plates "
                f"is only {height_mm:.1f} mm high in {view.name}; must be smaller"
            )
        return thickness, ()
    volume_ml = breast_volume_ml(breast)
    fitted = population_thickness_mm(view.name, volume_ml)
    thickness = min(fitted, MAX_OF_HEIGHT * height_mm)
    if settings.force_n is not None:
        return thickness, ()
    axilla = ", counted with the tissue towards the axilla" if breast.open_end is not None else ""
    fit = f"the population fit for a breast of {volume_ml:.0f} mL{axilla}"
    taken = f"{thickness:.1f} mm from {fit}"
    if thickness < fitted:
        taken = (
            f"{thickness:.1f} mm, {100.0 * MAX_OF_HEIGHT:.0f} % of the breast's height between "
            f"the plates ({height_mm:.1f} mm), which {fit} exceeds ({fitted:.1f} mm)"
        )
    return thickness, (f"{view.folder}: thickness not given; {taken}",)


def _check_heights(
    support_mm: float, paddle_mm: float, lattice: Lattice, edge_mm: float, view: View
) -> None:
    """Refuse given heights that do not compress: beside the breast, or wider than it."""
    low, high = heights_beyond_edge_mm(lattice, edge_mm)
    found = f"compression.support_z_mm, paddle_z_mm: found {support_mm:g} and {paddle_mm:g}"
    tissue = f"the breast lies between {low:.1f} and {high:.1f} mm in {view.name}"
    if not low < 0.5 * (support_mm + paddle_mm) < high:
        raise InputError(
            f"{found}, but {tissue}; the midpoint between the plates must be within, otherwise "
            f"they would displace the whole breast"
        )
    if support_mm <= low and paddle_mm >= high:
        raise InputError(f"{found}, but {tissue}; a plate must touch it")


def heights_beyond_edge_mm(lattice: Lattice, edge_mm: float) -> tuple[float, float]:
    """Lowest and highest face of the tissue between the plates at rest, compression frame, mm."""
    return heights_mm(lattice, tissue_beyond_edge(lattice, edge_mm))


def heights_mm(lattice: Lattice, tissue: NDArray[np.bool_]) -> tuple[float, float]:
    """Lowest and highest face of some of a lattice's tissue, compression frame, mm."""
    levels = np.flatnonzero(tissue.any(axis=(0, 1)))
    spacing = lattice.frame.spacing_mm[2]
    low, high = lattice.frame.axis_mm(2)[levels[[0, -1]]]
    return float(low - 0.5 * spacing), float(high + 0.5 * spacing)


def forward_height_mm(lattice: Lattice, edge_mm: float) -> float:
    """Mean height of the tissue in the front half of what lies between the plates, mm.

    What reaches forward is the breast; the tissue at the chest wall may stand higher. Where tissue
    is symmetric about a height, this is it.
    """
    forward = lattice.frame.axis_mm(0) >= 0.5 * (edge_mm + lattice.front_mm)
    weight = lattice.tissue[forward].sum(axis=(0, 1))
    return float((weight * lattice.frame.axis_mm(2)).sum() / weight.sum())

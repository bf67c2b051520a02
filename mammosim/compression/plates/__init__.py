"""Paddle and breast support: what they are (`solids`), and where they go (`placement`)."""

from mammosim.compression.plates.placement import (
    heights_beyond_edge_mm,
    held_tissue,
    place_plates,
    plate_edge_mm,
    population_thickness_mm,
)
from mammosim.compression.plates.solids import EDGE_RADIUS_MM, SHAPES, Panel, PlatePlace, Plates

__all__ = [
    "EDGE_RADIUS_MM",
    "SHAPES",
    "Panel",
    "PlatePlace",
    "Plates",
    "heights_beyond_edge_mm",
    "held_tissue",
    "place_plates",
    "plate_edge_mm",
    "population_thickness_mm",
]

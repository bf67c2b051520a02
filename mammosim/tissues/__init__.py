"""The tissue table: labels, stiffness and material of each tissue, and label maps."""

from mammosim.tissues.label_maps import LABEL_MAPS, load_label_map
from mammosim.tissues.table import LESION_LABELS, STIFFNESS_SETS, TISSUES, Tissue, stiffness_kpa

__all__ = [
    "LABEL_MAPS",
    "LESION_LABELS",
    "STIFFNESS_SETS",
    "TISSUES",
    "Tissue",
    "load_label_map",
    "stiffness_kpa",
]

"""The tissue table: labels, stiffness and material of each tissue, and label maps."""

from mammosim.tissues.label_maps import (
    DEFAULT_LABELS,
    LABEL_MAPS,
    decimals_of,
    in_whole_numbers,
    load_label_map,
    nearest_tissue,
)
from mammosim.tissues.materials import (
    CALCIFICATIONS,
    COMPOSITION_SETS,
    FOREIGN_MATERIALS,
    MATERIAL_NAMES,
    Material,
    composition,
    density_g_cm3,
)
from mammosim.tissues.table import (
    LESION_LABELS,
    SKIN_SHEETS,
    SKIN_THICKNESS_MM,
    STIFFNESS_SETS,
    TISSUES,
    Moduli,
    SkinSheet,
    Tissue,
    poisson_ratio,
    stiffening,
    stiffness_kpa,
)

__all__ = [
    "CALCIFICATIONS",
    "COMPOSITION_SETS",
    "DEFAULT_LABELS",
    "FOREIGN_MATERIALS",
    "LABEL_MAPS",
    "LESION_LABELS",
    "MATERIAL_NAMES",
    "SKIN_SHEETS",
    "SKIN_THICKNESS_MM",
    "STIFFNESS_SETS",
    "TISSUES",
    "Material",
    "Moduli",
    "SkinSheet",
    "Tissue",
    "composition",
    "decimals_of",
    "density_g_cm3",
    "in_whole_numbers",
    "load_label_map",
    "nearest_tissue",
    "poisson_ratio",
    "stiffening",
    "stiffness_kpa",
]

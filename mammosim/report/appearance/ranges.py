"""Ranges of what a mammogram looks like in numbers, measured on clinical images.

Twelve CC and five MLO digital mammograms of about seven women, public sample data of the projects
BIRADS_classifier, breast_cancer_classifier and GMIC (New York University), in two manufacturers'
processing; shape and muscle also on 24 digitized films. Ranges are from the lowest to the highest
value found. The images themselves are not part of this project.
"""

from __future__ import annotations

from typing import NamedTuple

WIDENED = 0.1
"""Ranges are widened by this part at either end, for the few images that they are from."""

SOURCE = {
    "CC": "our measurement: 12 clinical CC images of about 7 women, lowest to highest, widened by "
    "a tenth",
    "MLO": "our measurement: 5 clinical MLO images (shape and muscle: and 24 films), lowest to "
    "highest, widened by a tenth",
}


class Measure(NamedTuple):
    """What is measured, and its range in CC and MLO; None where none was measured."""

    name: str
    unit: str
    cc: tuple[float, float] | None
    mlo: tuple[float, float] | None


# Ranges of real mammograms; see above.
MEASURES = {
    "depth_over_length": Measure(
        "Chest wall to nipple over length along the wall", "", (0.3338, 0.5209), (0.29, 0.56)
    ),
    "top_over_greatest": Measure(
        "Width at the upper edge over greatest width", "", None, (0.72, 0.96)
    ),
    "nipple_grey": Measure("Grey of a nipple in profile, relative", "", (-0.2, 0.2), None),
    "grey_p5": Measure("Grey, 5th percentile", "", (0.0767, 0.2216), (0.0851, 0.1195)),
    "grey_p50": Measure("Grey, median", "", (0.2003, 0.3563), (0.1762, 0.3424)),
    "skew": Measure("Skewness of grey", "", (0.0087, 1.4257), (0.2312, 1.6333)),
    "subcut_5mm": Measure("Grey 5 mm under the skin line, relative", "", (0.0462, 0.3093), None),
    "subcut_10mm": Measure(
        "Grey 10 mm under the skin line, relative", "", (0.1058, 0.2613), (0.083, 0.2418)
    ),
    "skin_rise_mm": Measure(
        "Skin line, rise from air (10 to 90 %)", "mm", (0.55, 1.65), (0.55, 2.6)
    ),
    "skin_width_mm": Measure("Skin line, width at half height", "mm", (0.65, 1.7), (0.6, 1.6)),
    "beta_015_07": Measure(
        "Exponent of the spectrum, 0.15 to 0.7 per mm", "", (2.3591, 3.1351), (2.0858, 2.8793)
    ),
    "beta_07_2": Measure(
        "Exponent of the spectrum, 0.7 to 2 per mm", "", (2.4537, 3.2017), (2.2615, 3.2713)
    ),
    "band0.3_skew": Measure("Skewness of details of 0.3 mm", "", (0.509, 0.8593), (0.552, 1.1385)),
    "band0.6_skew": Measure("Skewness of details of 0.6 mm", "", (0.4861, 0.8474), None),
    "ridge0.4_p99": Measure("Strength of fine lines, 0.4 mm", "", (0.0867, 0.1167), None),
    "ridge0.8_p99": Measure("Strength of lines, 0.8 mm", "", (0.0955, 0.1538), (0.0904, 0.1767)),
    "ridge0.8_bright_dark": Measure(
        "Bright over dark lines, 0.8 mm", "", (1.1903, 1.4609), (1.3196, 1.4735)
    ),
    "ridge0.8_to_nipple": Measure("Lines that point to the nipple", "", (0.0833, 0.3049), None),
    "ridge0.8_length_mm": Measure("Length of lines", "mm", (5.2195, 10.2304), None),
    "loc_p90_over_p10": Measure(
        "Spread of local contrast (90th over 10th percentile)", "", (2.1023, 3.8264), None
    ),
    "bright_share": Measure("Share of bright area", "", (0.0605, 0.3664), None),
    "margin_lattice_share_over_5": Measure(
        "Share of the margin with a regular pattern", "", (0.0, 0.3), (0.0, 0.3)
    ),
    "muscle_grey": Measure("Pectoral muscle, grey", "", None, (0.3416, 0.8149)),
    "muscle_texture": Measure("Pectoral muscle, texture", "", None, (0.0473, 0.1028)),
    "muscle_anisotropy": Measure(
        "Pectoral muscle, anisotropy of texture", "", None, (0.0791, 0.5807)
    ),
    "pect_edge_15_85_mm": Measure(
        "Pectoral muscle, fall at its edge (85 to 15 %)", "mm", None, (0.7, 4.4)
    ),
    "pect_edge_wander_mm": Measure(
        "Pectoral muscle, edge from a straight line", "mm", None, (1.2334, 3.4604)
    ),
    "pect_top_mm": Measure("Pectoral muscle, width at the upper edge", "mm", None, (30.0, 58.0)),
    "pect_down_mm": Measure(
        "Pectoral muscle, length along the chest wall", "mm", None, (104.0, 160.0)
    ),
}

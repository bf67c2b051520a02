"""What the values of a volume stand for, beside it: `labels.json` and 3D Slicer's colour table."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from mammosim.compression import CompressedBreast
from mammosim.export.atomic import write_json, write_text
from mammosim.phantom import (
    LABELS_FILE,
    BreastPhantom,
    LabelledLesion,
    LabelTable,
    table_values,
)
from mammosim.projection import compressed_end

COLOURS = {
    "air": (0, 0, 0, 0), "adipose": (245, 222, 140, 255), "skin": (222, 184, 160, 255),
    "gland": (205, 92, 92, 255), "nipple": (160, 82, 70, 255), "muscle": (178, 34, 34, 255),
    "ligament": (240, 240, 220, 255), "tdlu": (255, 127, 80, 255), "duct": (255, 160, 122, 255),
    "artery": (220, 20, 60, 255), "vein": (65, 105, 225, 255), "mass": (50, 205, 50, 255),
    "calcification": (255, 255, 255, 255), "clip": (0, 206, 209, 255),
    "ligament_eighth": (244, 224, 150, 255), "ligament_quarter": (244, 226, 160, 255),
    "gland_half": (225, 157, 116, 255),
    "implant_silicone": (135, 206, 235, 255), "implant_saline": (100, 180, 225, 255),
    "pmma": (190, 190, 190, 255), "water": (70, 130, 220, 255), "lung": (224, 176, 255, 255),
    "iodine_1mg": (216, 191, 216, 255), "iodine_2mg": (186, 85, 211, 255),
    "iodine_5mg": (148, 0, 211, 255), "iodine_10mg": (75, 0, 130, 255),
    "ligament_half": (243, 231, 180, 255), "lymph_node": (123, 104, 238, 255),
    "benign_calcification": (230, 230, 250, 255),
    "benign_calcification_eighth": (243, 223, 154, 255),
    "benign_calcification_quarter": (241, 224, 168, 255),
    "benign_calcification_half": (238, 226, 195, 255),
}  # fmt: skip
"""Red, green, blue and opacity of each tissue; chosen."""


def table_of_phantom(breast: BreastPhantom) -> LabelTable:
    """What the values of an uncompressed breast's own voxels stand for."""
    end = breast.open_end
    return LabelTable(
        breast.laterality, dict(breast.tissue_of_label), _lesions(breast),
        muscle_standing=1.0 if end is None else end.standing,
    )  # fmt: skip


def table_of_compressed(compressed: CompressedBreast) -> LabelTable:
    """What the values of a compressed breast's voxels stand for, and how it is held."""
    breast, view = compressed.phantom, compressed.view
    side, points_mm = compressed_end(compressed, compressed.plate_edge_mm)
    corners = _corners(view.compression_from_breast(points_mm))
    return LabelTable(
        view.laterality, dict(breast.tissue_of_label), _lesions(breast), view.name,
        view.mlo_angle_deg, compressed.support_z_mm, compressed.paddle_z_mm,
        compressed.plate_edge_mm,
        end_side=side, end_points_mm=corners,
    )  # fmt: skip


def _corners(points_mm: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    """Of points, those that can bound a shadow along y: corners of their hull over y and z."""
    if len(points_mm) > 3 and (np.ptp(points_mm[:, 1:], axis=0) > 1e-6).all():
        points_mm = points_mm[ConvexHull(points_mm[:, 1:], qhull_options="QJ").vertices]
    return tuple((float(x), float(y), float(z)) for x, y, z in points_mm)


def _lesions(breast: BreastPhantom) -> dict[int, LabelledLesion]:
    return {le.label: LabelledLesion(le.name, le.kind, le.fill) for le in breast.lesions}


def write_label_files(
    table: LabelTable, files: tuple[str, ...], folder: str | PathLike[str], colours: bool = True
) -> None:
    """Write `labels.json`, by which the volumes are read again, and `labels.ctbl` for 3D Slicer.

    Parameters
    ----------
    table : LabelTable
    files : tuple of str
        Names of the volumes in the folder that it holds for.
    folder : path
    colours : bool
        Whether the colour table is written too.

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    write_json(Path(folder) / LABELS_FILE, table_values(table, files))
    if colours:
        write_text(Path(folder) / "labels.ctbl", colour_table(table))


def colour_table(table: LabelTable) -> str:
    """Lines `value name red green blue opacity`, names without blanks (Slicer's colour files).

    Examples
    --------
    >>> print(colour_table(LabelTable("L", {0: "air", 1: "adipose"})), end="")
    # Color table file of mammosim
    0 air 0 0 0 0
    1 adipose 245 222 140 255
    """
    lines = ["# Color table file of mammosim"]
    for value, tissue in sorted(table.tissue_of_value.items()):
        lesion = table.lesions.get(value)
        name = "_".join((lesion.name if lesion else tissue).split()) or tissue
        lines.append(f"{value} {name} {' '.join(str(part) for part in COLOURS[tissue])}")
    return "".join(f"{line}\n" for line in lines)

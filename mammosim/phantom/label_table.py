"""`labels.json`: what each value of a volume that mammosim wrote stands for, and how it was held.

It lies beside the volumes that it names, so that a compressed breast can be read again: its lesions
keep their names, its side and its view are not guessed, and its plates are where they were.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.geometry import VIEW_NAMES, View
from mammosim.phantom.lesion_kinds import lesion_tissues
from mammosim.tissues import LESION_LABELS, TISSUES

LABELS_FILE = "labels.json"
FORMAT = "mammosim labels"
"""What the file calls itself: other programs have a `labels.json` too."""

MAX_BYTES = 1_000_000
"""Of the file, ten times one with every label in use."""

MAX_POINTS = 1000
"""Of an open end that are read; corners of a polygon are some ten."""

MARK_KEYS = ("support_z_mm", "paddle_z_mm", "plate_edge_mm")


@dataclass(frozen=True)
class LabelledLesion:
    """A lesion that has a value of its own.

    Parameters
    ----------
    name, kind : str
    fill : float
        Fraction of its voxels' volume that is its material.
    """

    name: str
    kind: str
    fill: float = 1.0


@dataclass(frozen=True)
class LabelTable:
    """What a volume's values stand for.

    Parameters
    ----------
    laterality : {"L", "R"}
    tissue_of_value : mapping of int to str
    lesions : mapping of int to LabelledLesion
        By value.
    compressed_for : str or None
        View whose plates hold the breast; None for an uncompressed one.
    mlo_angle_deg : float
    support_z_mm, paddle_z_mm, plate_edge_mm : float or None
        Heights of the plates' faces and x of their edge, compression frame, mm.
    end_side, end_points_mm
        Of `CompressedState`.
    in_patient_axes : bool
        Whether the volumes' axes are turned from the compression frame into the patient's.
    muscle_standing : float
        `OpenEnd.standing` of an uncompressed breast; 1 for others.
    """

    laterality: str
    tissue_of_value: Mapping[int, str]
    lesions: Mapping[int, LabelledLesion] = field(default_factory=dict)
    compressed_for: str | None = None
    mlo_angle_deg: float = 45.0
    support_z_mm: float | None = None
    paddle_z_mm: float | None = None
    plate_edge_mm: float | None = None
    in_patient_axes: bool = True
    end_side: float = 0.0
    end_points_mm: tuple[tuple[float, float, float], ...] = ()
    muscle_standing: float = 1.0

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) from the breast frame to the frame that the volumes' axes lie along."""
        if self.compressed_for is None or not self.in_patient_axes:
            return np.eye(3)
        return View(self.compressed_for, self.laterality, self.mlo_angle_deg).rotation


def table_values(table: LabelTable, files: tuple[str, ...]) -> dict[str, Any]:
    """What `labels.json` holds, as plain values.

    Parameters
    ----------
    table : LabelTable
    files : tuple of str
        Names of the volumes beside it that it holds for.
    """
    labels = []
    for value, tissue in sorted(table.tissue_of_value.items()):
        entry: dict[str, Any] = {"value": value, "tissue": tissue}
        if TISSUES[tissue].mixture:
            entry["fractions"] = dict(TISSUES[tissue].mixture)
        lesion = table.lesions.get(value)
        if lesion is not None:
            number = 1 + sorted(table.lesions).index(value)
            entry |= {"lesion_id": number, "name": lesion.name, "fill": lesion.fill}
        labels.append(entry)
    return {
        "format": FORMAT,
        "files": list(files),
        "laterality": table.laterality,
        "compressed_for": table.compressed_for,
        "mlo_angle_deg": table.mlo_angle_deg,
        **{key: getattr(table, key) for key in MARK_KEYS},
        "in_patient_axes": table.in_patient_axes,
        "end_side": table.end_side,
        "end_points_mm": [list(point) for point in table.end_points_mm],
        "muscle_standing": table.muscle_standing,
        "labels": labels,
    }


def find_label_table(path: Path) -> LabelTable | None:
    """The table beside a volume that mammosim wrote; None where there is none for it.

    Raises
    ------
    InputError
        If there is one that cannot be used.
    """
    beside = path.parent / LABELS_FILE
    try:
        values = json.loads(read_text(beside, MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        return None  # none, or another program's
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        return None
    files = values.get("files")
    if not isinstance(files, list) or path.name not in files:
        return None
    try:
        return _table(values)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{beside}: cannot be used ({error}); remove it to read {path.name} without it"
        ) from None


def _table(values: dict[str, Any]) -> LabelTable:
    tissues: dict[int, str] = {}
    lesions: dict[int, LabelledLesion] = {}
    for entry in values["labels"]:
        value, tissue = entry["value"], entry["tissue"]
        if type(value) is not int or not 0 <= value < 256 or value in tissues:
            raise ValueError(f"value {value!r:.40}, expected 0 to 255, each once")
        if tissue not in TISSUES:
            raise ValueError(f"tissue {tissue!r:.40}, expected one of {', '.join(TISSUES)}")
        tissues[value] = tissue
        if "name" in entry:
            lesions[value] = _lesion(entry, value, tissue)
    side, view = values["laterality"], values.get("compressed_for")
    if side not in ("L", "R"):
        raise ValueError(f"laterality {side!r:.40}, expected L or R")
    if view is not None and view not in VIEW_NAMES:
        raise ValueError(f"compressed_for {view!r:.40}, expected one of {', '.join(VIEW_NAMES)}")
    angle = _number(values, "mlo_angle_deg")
    support, paddle, edge = (_number(values, key) for key in MARK_KEYS)
    return LabelTable(
        side, tissues, lesions, view, 45.0 if angle is None else angle, support, paddle, edge,
        values.get("in_patient_axes") is not False, _number(values, "end_side") or 0.0,
        tuple(_point(entry) for entry in values.get("end_points_mm", [])[:MAX_POINTS]),
        _standing(values),
    )  # fmt: skip


def _standing(values: dict[str, Any]) -> float:
    part = _number(values, "muscle_standing")
    part = 1.0 if part is None else part
    if not 0.0 < part <= 1.0:
        raise ValueError(f"muscle_standing {part:g}, expected above 0 and up to 1")
    return part


def _point(entry: Any) -> tuple[float, float, float]:
    x, y, z = (_number({"end_points_mm": part}, "end_points_mm") for part in entry)
    if x is None or y is None or z is None:
        raise ValueError("end_points_mm, expected three numbers each")
    return x, y, z


def _lesion(entry: dict[str, Any], value: int, tissue: str) -> LabelledLesion:
    if value not in LESION_LABELS or tissue not in lesion_tissues():
        raise ValueError(f"value {value} of tissue {tissue}, expected no lesion's name")
    fill = _number(entry, "fill")
    fill = 1.0 if fill is None else fill
    if not 0.0 < fill <= 1.0:
        raise ValueError(f"fill {fill:g}, expected above 0 and up to 1")
    return LabelledLesion(str(entry["name"])[:64], lesion_tissues()[tissue], fill)


def _number(values: dict[str, Any], key: str) -> float | None:
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e6:
        raise ValueError(f"{key} {value!r:.40}, expected a number")
    return float(value)

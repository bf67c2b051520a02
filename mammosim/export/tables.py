"""Tables and scalars: lesions.csv, convergence.csv, compression.json."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.export.atomic import write_json, write_text
from mammosim.targets import Target

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""First letters of a cell that a spreadsheet computes, also in their full width."""


def write_lesions(targets: Sequence[Target], path: str | PathLike[str]) -> None:
    """Write `lesions.csv`: one row per target and view.

    Parameters
    ----------
    targets : sequence of Target
    path : path

    Notes
    -----
    The columns are the fields of `Target`, which name their units. Lengths have four decimals; what
    is not known is empty.
    """
    write_table(Target, targets, path)


def read_lesions(path: str | PathLike[str]) -> list[Target]:
    """Read what `write_lesions` wrote; an empty number is NaN.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    list of Target
        One per row, in the file's order.

    Raises
    ------
    InputError
        If the file is not there, or is not such a table.
    """
    path = Path(path)
    try:
        rows = csv.DictReader(io.StringIO(read_text(path)), strict=True)
        return [
            Target(**{name: _FROM_CELL[_TARGET_TYPES[name]](cell) for name, cell in row.items()})
            for row in rows
        ]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError, TypeError, KeyError, csv.Error) as error:
        raise InputError(
            f"{path}: expected a table with the columns of lesions.csv ({error})"
        ) from None


def write_table(kind: type[Any], rows: Iterable[Any], path: str | PathLike[str]) -> None:
    """Write one line a row of a frozen dataclass, with its fields for columns.

    Parameters
    ----------
    kind : type
        The dataclass, for the header of a table without rows.
    rows : iterable of that dataclass
        Numbers get four decimals; what is not known is empty.
    path : path
    """
    header = [field.name for field in fields(kind)]
    cells = ([_cell(value, ".4f") for value in astuple(row)] for row in rows)
    write_text(path, _csv(header, cells))


def write_convergence(history: NDArray[np.void], path: str | PathLike[str]) -> None:
    """Write a solver's history as CSV.

    Parameters
    ----------
    history : structured ndarray, (n,)
        One element per iteration.
    path : path

    Notes
    -----
    One row per iteration under a header of the array's field names; numbers have nine significant
    digits.
    """
    header = list(history.dtype.names or ())
    rows = ([_cell(value, ".9g") for value in row] for row in history.tolist())
    write_text(path, _csv(header, rows))


def write_compression(compressed: CompressedBreast, path: str | PathLike[str]) -> None:
    """Write the scalars of a compression as `compression.json`.

    Parameters
    ----------
    compressed : CompressedBreast
    path : str or path
        JSON file; replaced as a whole if it is there.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    Plates (breast frame, mm), thickness (mm), force (N) and what the mechanical model measures of
    its own result, such as folded cells. Fields, such as the displacement, are in other files.
    """
    write_json(path, compression_summary(compressed))


def compression_summary(compressed: CompressedBreast) -> dict[str, Any]:
    """What `compression.json` holds, as plain values.

    Parameters
    ----------
    compressed : CompressedBreast

    Returns
    -------
    dict
        View, model, whether it converged, heights of the plates' faces (compression frame, mm), the
        nipple before compression (breast frame, mm), then the model's own measures, each with its
        unit in its name, and the notes.
    """
    return {
        "view": compressed.view.label,
        "laterality": compressed.view.laterality,
        "angle_deg": compressed.view.angle_deg,
        "model": compressed.model,
        "converged": compressed.converged,
        "thickness_mm": compressed.thickness_mm,
        "support_z_mm": compressed.support_z_mm,
        "paddle_z_mm": compressed.paddle_z_mm,
        "plate_edge_mm": compressed.plate_edge_mm,
        "nipple_mm": compressed.phantom.nipple_mm,
        **compressed.measures,
        "notes": list(compressed.notes),
    }


def _csv(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return stream.getvalue()


def _cell(value: Any, number_format: str) -> str:
    """A value as text; the same value always reads the same."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        if not math.isfinite(value):
            return ""
        text = format(value, number_format)
        return text.removeprefix("-") if float(text) == 0.0 else text
    return csv_text(value) if isinstance(value, str) else str(value)


def csv_text(text: str) -> str:
    """Text for a cell of a table that a spreadsheet may open.

    Spreadsheets compute cells that begin with ``= + - @``, a tab or a carriage return, whatever
    quotes are around them; an apostrophe before it makes them text (OWASP, "CSV Injection").

    Examples
    --------
    >>> csv_text("=1+1"), csv_text("mass 1")
    ("'=1+1", 'mass 1')
    """
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def text_of_csv(cell: str) -> str:
    """What `csv_text` made a cell of.

    Examples
    --------
    >>> text_of_csv("'=1+1"), text_of_csv("'quoted'")
    ('=1+1', "'quoted'")
    """
    return cell[1:] if cell[:1] == "'" and cell[1:].startswith(FORMULA_STARTS) else cell


_TARGET_TYPES = {field.name: str(field.type) for field in fields(Target)}
_FROM_CELL: dict[str, Callable[[str], Any]] = {
    "int": int,
    "float": lambda cell: float(cell) if cell else math.nan,
    "bool": lambda cell: cell == "true",
    "str": text_of_csv,
}

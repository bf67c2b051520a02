"""Where focal spot, support, detector and pixels of a view were: written, and read back."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from os import PathLike
from pathlib import Path

from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.export.atomic import write_json
from mammosim.geometry import Gantry, View


def write_geometry(gantry: Gantry, path: str | PathLike[str]) -> None:
    """Write where tube and detector stand, as JSON.

    Parameters
    ----------
    gantry : Gantry
    path : path
        Usually `geometry.json` in a view's folder, from which `mammosim locate` reads it back.

    Notes
    -----
    Keys are the fields of `Gantry` and, under `view`, those of `View`, with their units in their
    names. `title` and `spot` are there for unusual views only.
    """
    values = asdict(gantry)
    for key in ("title", "spot"):  # of unusual views alone
        if not values["view"][key]:
            del values["view"][key]
    write_json(path, values)


def read_geometry(path: str | PathLike[str]) -> Gantry:
    """Read what `write_geometry` wrote.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    Gantry
        Focal spot, support, detector and view, gantry frame, mm.

    Raises
    ------
    InputError
        If the file is not there, or is not one of these.
    """
    path = Path(path)
    try:
        values = json.loads(read_text(path))
        view = View(**values.pop("view"))
        return Gantry(view=view, **values)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; was this view projected?") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        known = ", ".join(field.name for field in fields(Gantry))
        raise InputError(f"{path}: expected JSON with {known} ({error})") from None

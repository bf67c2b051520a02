"""A small phantom of the user's own, a configuration of it, and the command line to run it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from make_phantom import half_ellipsoid_breast
from typer.testing import CliRunner

from mammosim import cli
from mammosim.config import write_yaml

RUNNER = CliRunner()

FEW_PHOTONS = {"scatter": {"photons": 10_000}}
"""Acquisition for tests in which scatter only has to be there: a twentieth of the usual time."""

SMALL = {
    "acquisition": FEW_PHOTONS,
    "compression": {"model": "springs", "thickness_mm": 36, "resolution_mm": 3},
    "projection": {"pixel_mm": 0.8},
    "seed": 3,
}


def invoke(*arguments: object):
    """Run the command line and give its result."""
    return RUNNER.invoke(cli.app, [str(argument) for argument in arguments])


def save_breast(folder: Path) -> Path:
    """Write `breast.npz` into a folder."""
    breast = half_ellipsoid_breast()
    np.savez(
        folder / "breast.npz",
        labels=breast.labels,
        voxel_mm=breast.voxel_mm,
        origin_mm=breast.origin_mm,
    )
    return folder


def write(folder: Path, name: str = "run.yaml", **changes) -> Path:
    """A small configuration of that phantom; keys are replaced section by section."""
    values = {
        "phantom": {
            "file": "breast.npz",
            "lesions": [
                {"name": "ball", "kind": "mass", "diameter_mm": 6, "position_mm": [12, 8, 6]}
            ],
            "landmarks": [{"name": "mark", "position_mm": [14, -6, -5]}],
        },
        **SMALL,
    }
    values.update(changes)
    path = folder / name
    write_yaml(values, path)
    return path


def read_table(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file by its header."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))

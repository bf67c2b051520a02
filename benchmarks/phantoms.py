"""Whether the default compression copes with phantoms that others might bring.

    python benchmarks/phantoms.py [--fda p_1.mhd] [--elements 6]

A generated breast is written in each format and read back, changed as other phantoms differ from
it (no muscle, no skin, long voxels, a slab of muscle in UWCEM's files, cut off in front of the
chest wall), made small and large, and given stiffnesses far from the usual ones. Each is compressed
with default settings in CC and MLO; a row says how that ended, or which sentence refused it.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mammosim
from mammosim.export import WRITERS
from mammosim.geometry import VoxelFrame
from mammosim.phantom import BreastPhantom

UWCEM_MEDIUM = {"air": "-1", "skin": "-2", "muscle": "-4", "gland": "1.2", "ligament": "2"}
"""Medium of each tissue in `mtype.txt`; 3.1 for all others, which are fat."""

UWCEM_VOXEL_MM = 0.5

MUSCLE_LAYERS = 10
"""Of 0.5 mm, behind the breast: UWCEM's phantoms end with 5 mm of muscle."""

LONG_STEP = 3
"""Voxels along z of which one is kept."""


class Given(NamedTuple):
    """A phantom that somebody brings, and settings of theirs."""

    name: str
    breast: BreastPhantom
    keys: dict[str, Any]


def labels_of(breast: BreastPhantom, tissue: str) -> list[int]:
    """Labels of a tissue."""
    return [label for label, name in breast.tissue_of_label.items() if name == tissue]


def with_tissue_as(breast: BreastPhantom, tissue: str, other: int) -> BreastPhantom:
    """The same breast, a tissue of which has another label."""
    there = np.isin(breast.labels, labels_of(breast, tissue))
    return replace(breast, labels=np.where(there, np.uint8(other), breast.labels))


def written_as_uwcem(breast: BreastPhantom, folder: Path) -> Path:
    """`mtype.txt` and `breastInfo.txt` of a breast with voxels of 0.5 mm, muscle behind it."""
    text = np.array([UWCEM_MEDIUM.get(breast.tissue_of_label.get(label, "air"), "3.1")
                     for label in range(256)])  # fmt: skip
    media = text[breast.labels]
    wall = np.where(media[:1] == "-1", "-1", "-4")
    media = np.concatenate([np.repeat(wall, MUSCLE_LAYERS, axis=0), media])
    sides = "\n".join(f"s{axis + 1}={size}" for axis, size in enumerate(media.shape))
    (folder / "breastInfo.txt").write_text(f"breast ID=made\n{sides}\nclassification=2\n")
    path = folder / "mtype.txt"
    path.write_text("\n".join(media.ravel(order="F").tolist()) + "\n")
    return path


def made(volume_ml: float = 300.0, voxel_mm: float = 1.0) -> BreastPhantom:
    """A generated breast."""
    return mammosim.generate_phantom(
        density="heterogeneous", volume_ml=volume_ml, voxel_mm=voxel_mm, seed=21, laterality="L"
    )


def phantoms(fda: Path | None, folder: Path) -> Iterator[Given]:
    """All of them."""
    if fda is not None:
        yield Given("FDA, VICTRE", mammosim.read_phantom(fda, labels="victre"), {})
    breast = made()
    yield Given("generated, 300 mL", breast, {})
    frame = VoxelFrame(breast.origin_mm, breast.voxel_mm, breast.labels.shape)
    for ending, write in WRITERS.items():
        path = folder / f"breast{ending}"
        write(breast.labels, frame, path)
        yield Given(f"the same as {ending}", mammosim.read_phantom(path, laterality="L"), {})
    small = made(150.0, UWCEM_VOXEL_MM)
    yield Given(
        "150 mL as UWCEM's text", mammosim.read_phantom(written_as_uwcem(small, folder)), {}
    )
    adipose = labels_of(breast, "adipose")[0]
    yield Given("no muscle", with_tissue_as(breast, "muscle", adipose), {})
    bare = replace(with_tissue_as(breast, "skin", adipose), open_end=None)
    yield Given("no skin", bare, {})
    yield Given("no skin, `skin` given", bare, {"skin": {"young_kpa": 56.0}})
    step = np.array([1, 1, LONG_STEP])
    long = replace(breast, labels=breast.labels[:, :, ::LONG_STEP], voxel_mm=breast.voxel_mm * step)
    yield Given("voxels of 1 x 1 x 3 mm", long, {})
    behind = int(np.searchsorted(frame.axis_mm(0), 15.0))
    ahead_mm = behind * breast.voxel_mm * (1.0, 0.0, 0.0)
    cut = replace(breast, labels=breast.labels[behind:], origin_mm=breast.origin_mm + ahead_mm)
    yield Given("cut off 15 mm in front of the wall", cut, {})
    yield Given("150 mL", made(150.0), {})
    yield Given("1400 mL", made(1400.0, 1.5), {})
    for name, stiffness in (
        ("gland 400 kPa", {"gland": 400.0}),
        ("fat 0.1 kPa", {"adipose": 0.1}),
        ("gland 10 MPa, fat 0.5 kPa", {"gland": 1e4, "adipose": 0.5}),
    ):
        yield Given(name, breast, {"stiffness_kpa": stiffness})


def row(given: Given, view: str, elements: float) -> str:
    """How a compression ended."""
    start = time.process_time()
    try:
        found = mammosim.compress(given.breast, view, resolution_mm=elements, **given.keys)
    except mammosim.InputError as refusal:
        return f"| {given.name} | {view} | refused: {refusal} | | | | |"
    except mammosim.NotConverged as stop:
        return f"| {given.name} | {view} | {stop} | | | | |"
    cpu, m = time.process_time() - start, found.measures
    return (
        f"| {given.name} | {view} | converged | {found.thickness_mm:.1f} mm "
        f"| {found.force_n:.1f} N "
        f"| {m['error_mm']:.4f}, {m['largest_error_mm']:.3f} mm | {m['smallest_j']:.2f} "
        f"| {cpu:.1f} s |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fda", type=Path, help="FDA's phantom, p_1.mhd")
    parser.add_argument("--elements", type=float, default=6.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for given in phantoms(arguments.fda, Path(folder)):
            for view in ("CC", "MLO"):
                print(row(given, view, arguments.elements), flush=True)


if __name__ == "__main__":
    main()

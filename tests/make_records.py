"""Small but realistic records of every stage, for the tests of what is written about them.

A hemisphere of fat with one ball of gland and two or three lesions, moved by a smooth made-up
displacement; nothing here runs a solver.
"""

from __future__ import annotations

import numpy as np

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast, DisplacementField
from mammosim.geometry import Gantry, View, VoxelFrame
from mammosim.phantom import BreastPhantom, Lesion
from mammosim.projection import PathLengths
from mammosim.targets import Target

RADIUS_MM = 40.0
THICKNESS_MM = 52.0
PIXEL_MM = 0.5
SHIFT_MM = np.array([3.0, 1.0, -4.0])
LESIONS = (
    ("mass 1", "mass", 151, "mass", (20.0, 8.0, 6.0), 6.0),
    ("calcs", "calcification", 152, "calcification", (14.0, -12.0, -5.0), 3.0),
    ("clip A", "clip", 153, "clip", (20.0, 8.0, 8.0), 1.5),
)
"""Name, kind, label, tissue, position in the breast frame in mm and radius in mm."""

HISTORY = np.array(
    [(i, 10.0 ** (-i / 2), 3.0 * 0.8**i, i > 6) for i in range(10)],
    dtype=[("iteration", "i4"), ("residual", "f8"), ("mean_move_mm", "f8"), ("settled", "?")],
)


def make_phantom(laterality: str = "L", voxel_mm: float = 2.0) -> BreastPhantom:
    """A hemisphere of fat with gland and lesions, breast frame."""
    nx, ny = round(RADIUS_MM / voxel_mm) + 2, 2 * round(RADIUS_MM / voxel_mm) + 3
    origin = np.array([0.0, -(ny - 1) / 2 * voxel_mm, -(ny - 1) / 2 * voxel_mm])
    frame = VoxelFrame(origin, np.full(3, voxel_mm), (nx, ny, ny))
    points = frame.position_mm(np.stack(np.indices((nx, ny, ny)), axis=-1))
    labels = np.zeros((nx, ny, ny), np.uint8)
    labels[np.linalg.norm(points, axis=-1) <= RADIUS_MM] = 1
    labels[np.linalg.norm(points - [16.0, 0.0, 0.0], axis=-1) <= 15.0] = 29
    for _, _, label, _, position, radius in LESIONS:
        labels[np.linalg.norm(points - np.array(position), axis=-1) <= radius] = label
    lesions = tuple(
        Lesion(name, kind, label, tissue, np.array(position), 4.19 * radius**3)
        for name, kind, label, tissue, position, radius in LESIONS
    )
    return BreastPhantom(
        labels=labels,
        voxel_mm=frame.spacing_mm,
        origin_mm=origin,
        laterality=laterality,
        tissue_of_label={0: "air", 1: "adipose", 29: "gland", 151: "mass", 152: "calcification",
                         153: "clip"},
        nipple_mm=np.array([RADIUS_MM, 0.0, 0.0]),
        lesions=lesions,
        source="hemisphere.nii.gz",
    )  # fmt: skip


def make_compressed(
    view: View, *, converged: bool = True, notes: tuple[str, ...] = ()
) -> CompressedBreast:
    """The hemisphere under plates, by a made-up smooth displacement."""
    frame = VoxelFrame(np.array([0.0, -44.0, -44.0]), np.full(3, 4.0), (12, 23, 23))
    points = frame.position_mm(np.stack(np.indices(frame.shape), axis=-1))
    moved = points * [1.15, 1.1, THICKNESS_MM / (2 * RADIUS_MM)] - points
    tissue = (np.linalg.norm(points, axis=-1) <= RADIUS_MM) & (points[..., 0] >= 0.0)
    return CompressedBreast(
        phantom=make_phantom(view.laterality),
        view=view,
        model="springs",
        field=DisplacementField(frame, moved.astype(np.float32), tissue, view.rotation),
        support_z_mm=-THICKNESS_MM / 2,
        paddle_z_mm=THICKNESS_MM / 2,
        plate_edge_mm=5.0,
        converged=converged,
        measures={"force_n": 91.3, "contact_area_mm2": 8123.4, "pressure_kpa": 11.24,
                  "volume_before_mm3": 134041.3, "volume_after_mm3": 130288.1,
                  "inverted_cells": 3.0, "residual": 4.1e-7},
        history=HISTORY,
        notes=notes,
    )  # fmt: skip


def make_gantry(view: View, pixel_mm: float = PIXEL_MM) -> Gantry:
    """A small detector under the hemisphere."""
    return Gantry(
        view=view,
        detector_edge_mm=5.0,
        support_z_mm=-THICKNESS_MM / 2,
        source_to_detector_mm=650.0,
        support_to_detector_mm=15.0,
        focal_spot_y_mm=0.0,
        pixel_mm=pixel_mm,
        rows=round(120 / pixel_mm),
        columns=round(60 / pixel_mm),
        y_min_mm=-60.0,
    )


def make_targets(view: View, gantry: Gantry | None = None) -> list[Target]:
    """One target a lesion, a landmark outside the picture, and the nipple."""
    gantry = gantry or make_gantry(view)
    places = [(name, kind, position, 4.19 * r**3) for name, kind, _, _, position, r in LESIONS]
    places += [("axillary tail", "landmark", (8.0, 300.0, 0.0), float("nan"))]
    places += [("nipple", "nipple", (RADIUS_MM, 0.0, 0.0), float("nan"))]
    return [
        _target(number, name, kind, np.array(position), volume, view, gantry)
        for number, (name, kind, position, volume) in enumerate(places, start=1)
    ]


def _target(number, name, kind, place, volume, view, gantry) -> Target:
    after = gantry.gantry_from_breast(place + SHIFT_MM)
    row, column = gantry.project(after)
    in_field = bool(-0.5 <= row < gantry.rows - 0.5 and -0.5 <= column < gantry.columns - 0.5)
    return Target(
        number, name, kind, view.folder, volume, *map(float, place), "1:30", 21.5, 9.25,
        *map(float, after), *map(float, SHIFT_MM), float(np.linalg.norm(SHIFT_MM)),
        0.98, 1.12, 0.71, float(row), float(column), 24.125, in_field,
        extent_mm=2.0 * (0.75 * volume / np.pi) ** (1 / 3) + 2.0,
    )  # fmt: skip


def make_paths(view: View, gantry: Gantry | None = None) -> PathLengths:
    """Path lengths of fat, gland and the lesions: discs where the targets project."""
    gantry = gantry or make_gantry(view)
    rows, columns = np.indices((gantry.rows, gantry.columns))
    centre = gantry.project(gantry.gantry_from_breast([0.0, 0.0, 0.0]))

    def dome(row: float, column: float, radius_mm: float) -> np.ndarray:
        distance = np.hypot(rows - row, columns - column) * gantry.pixel_mm
        return np.sqrt(np.maximum(radius_mm**2 - distance**2, 0.0))

    channels = [np.minimum(dome(*centre, 50.0) * 2, THICKNESS_MM), dome(*centre, 20.0)]
    for target, (_, _, _, _, _, radius) in zip(make_targets(view, gantry), LESIONS, strict=False):
        channels.append(dome(target.image_row_px, target.image_col_px, radius) * 2)
    length = np.array(channels, dtype=np.float32)
    return PathLengths(
        tissues=("adipose", "gland", *(name for name, *_ in LESIONS)),
        materials=("adipose", "gland", "mass", "calcification", "titanium"),
        lesion_labels=(0, 0, 151, 152, 153),
        length_mm=length,
        attenuating_mm=length,
        gantry=gantry,
        thickness_mm=THICKNESS_MM,
        force_n=91.3,
        clipped_fraction=0.001,
    )


def make_mammogram(view: View, *, seed: int = 1, force_n: float = 91.3) -> Mammogram:
    """A noisy picture of the made-up path lengths with its technique."""
    paths = make_paths(view)
    mu_per_mm = np.array([0.05, 0.08, 0.085, 0.6, 1.0])
    depth = np.tensordot(mu_per_mm, paths.length_mm, axes=1)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, depth.shape)
    raw = np.clip(16000 * np.exp(-depth) * (1 + noise), 1, 16383)
    shown = np.clip(1000 * (np.log(16383.0) - np.log(raw)), 0, 4095)
    return Mammogram(
        for_processing=raw.astype(np.uint16),
        for_presentation=shown.astype(np.uint16),
        window_center=2200.0,
        window_width=2400.0,
        gantry=paths.gantry,
        thickness_mm=THICKNESS_MM,
        force_n=force_n,
        target="W",
        filter="Rh",
        filter_mm=0.05,
        kvp=28.0,
        mas=90.123,
        hvl_mm_al=0.525,
        air_kerma_mgy=5.31,
        dose_mgy=1.4567,
        grid=True,
        measures={
            "density_percent": 17.3,
            "volumetric_density_percent": 17.3,
            "scatter_to_primary": 0.12,
        },
        notes=(),
    )

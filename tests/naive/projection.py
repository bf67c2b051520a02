"""Slow, simple twins of the projection's kernels, and breasts compressed by formula for tests."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mammosim.compression import CompressedBreast, InverseMap
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom
from mammosim.tissues import TISSUES


def phantom(labels, voxel_mm=1.0, origin_mm=(0.0, 0.0, 0.0), laterality="L", **fields):
    """A phantom with the labels of the tissue table, nipple at its most anterior tissue voxel."""
    voxel = np.broadcast_to(np.asarray(voxel_mm, dtype=float), 3).copy()
    origin = np.asarray(origin_mm, dtype=float)
    tissue = {block.label: name for name, block in TISSUES.items()}
    tissue |= {lesion.label: lesion.tissue for lesion in fields.get("lesions", ())}
    front = np.argwhere(labels)
    tip = front[front[:, 0].argmax()] if len(front) else np.zeros(3)
    fields.setdefault("nipple_mm", origin + tip * voxel)
    return BreastPhantom(
        np.ascontiguousarray(labels, dtype=np.uint8), voxel, origin, laterality, tissue, **fields
    )


def inverse_map(original_of, low_mm, high_mm, spacing_mm):
    """The inverse map of a formula: `original_of` takes and gives (n, 3), compression frame."""
    low, high = np.asarray(low_mm, float), np.asarray(high_mm, float)
    spacing = np.broadcast_to(np.asarray(spacing_mm, dtype=float), 3).copy()
    shape = tuple(int(n) + 1 for n in np.ceil((high - low) / spacing - 1e-9))
    frame = VoxelFrame(low, spacing, shape)
    places = frame.position_mm(np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3))
    original = original_of(places).reshape(*shape, 3)
    return InverseMap(frame, original.astype(np.float32))


def compressed(breast, inverse, view="CC", plates_mm=None, edge_mm=0.0, angle_deg=45.0, **field):
    """A compressed breast from an inverse map made by hand; `field` as its field may have it."""
    frame = inverse.frame
    top = frame.origin_mm[2] + frame.spacing_mm[2] * (frame.shape[2] - 1)
    low, high = plates_mm or (float(frame.origin_mm[2]), float(top))
    return CompressedBreast(
        phantom=breast,
        view=View(view, breast.laterality, angle_deg),
        model="none",
        field=SimpleNamespace(inverse=inverse, **field),
        support_z_mm=low,
        paddle_z_mm=high,
        plate_edge_mm=edge_mm,
        converged=True,
        measures={"force_n": 100.0},
        history=np.zeros(0, dtype=[("iteration", int)]),
    )


def unsqueezed(breast, view="CC", spacing_mm=4.0, **keys):
    """A breast left as it is, with an identity map on a coarse grid around it."""
    frame = breast.frame
    corners = frame.position_mm(
        [[i, j, k] for i in (-0.5, frame.shape[0] - 0.5) for j in (-0.5, frame.shape[1] - 0.5)
         for k in (-0.5, frame.shape[2] - 0.5)]
    )  # fmt: skip
    rotated = corners @ View(view, breast.laterality).rotation.T
    low, high = rotated.min(axis=0) - 1.0, rotated.max(axis=0) + 1.0
    return compressed(breast, inverse_map(lambda p: p, low, high, spacing_mm), view, **keys)


def chord(labels, start, end):
    """Length share of each label on the segment from `start` to `end`, in voxels (Siddon 1985).

    Voxel i covers i - 0.5 to i + 0.5. Returns an array of 256 shares of the segment's own length.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    cuts = [0.0, 1.0]
    for axis in range(3):
        change = end[axis] - start[axis]
        if change != 0.0:
            faces = np.arange(labels.shape[axis] + 1) - 0.5
            cuts.extend((faces - start[axis]) / change)
    cuts = np.unique(np.clip(cuts, 0.0, 1.0))
    middle = start + 0.5 * (cuts[1:] + cuts[:-1])[:, None] * (end - start)
    voxel = np.rint(middle).astype(int)
    inside = ((voxel >= 0) & (voxel < labels.shape)).all(axis=1)
    shares = np.zeros(256)
    np.add.at(shares, labels[tuple(voxel[inside].T)], np.diff(cuts)[inside])
    return shares


def plain_projection(breast, gantry):
    """Length in mm of each label [256, row, column] with no displacement, ray by ray."""
    lengths = np.zeros((256, gantry.rows, gantry.columns))
    for row in range(gantry.rows):
        for column in range(gantry.columns):
            ends = gantry.breast_from_gantry(_ray(gantry, row, column))
            start, end = breast.frame.index(ends)
            length = np.linalg.norm(ends[1] - ends[0])
            lengths[:, row, column] = length * chord(breast.labels, start, end)
    return lengths


def deformed_projection(breast_squeezed, gantry):
    """Length in mm of each label [256, row, column], piece by piece between the map's planes."""
    breast, inverse = breast_squeezed.phantom, breast_squeezed.inverse
    frame = inverse.frame
    planes = frame.origin_mm[2] + frame.spacing_mm[2] * np.arange(frame.shape[2])
    lengths = np.zeros((256, gantry.rows, gantry.columns))
    for row in range(gantry.rows):
        for column in range(gantry.columns):
            edge = np.array([gantry.detector_edge_mm, 0.0, gantry.support_z_mm])
            spot, pixel = _ray(gantry, row, column) + edge
            share = (spot[2] - planes) / (spot[2] - pixel[2])
            crossings = spot + share[:, None] * (pixel - spot)
            places = np.array([_bilinear(inverse, k, p) for k, p in enumerate(crossings)])
            voxels = breast.frame.index(places @ breast_squeezed.view.rotation)
            steps = np.linalg.norm(np.diff(crossings, axis=0), axis=1)
            for start, end, step in zip(voxels[:-1], voxels[1:], steps, strict=True):
                if np.isfinite(start).all() and np.isfinite(end).all():
                    lengths[:, row, column] += step * chord(breast.labels, start, end)
    return lengths


def _ray(gantry, row, column):
    """Focal spot and pixel centre in the gantry frame (2, 3)."""
    return np.array([gantry.focal_spot_mm, turned_pixel(gantry, row, column)])


def turned_pixel(gantry, row, column):
    """Pixel centres (..., 3) of a detector that was turned about the pivot, gantry frame."""
    flat = gantry.detector_xy_mm(row, column)
    arm = np.stack([flat[..., 1] - gantry.focal_spot_y_mm,
                    np.full(flat.shape[:-1], -gantry.pivot_to_detector_mm)], -1)  # fmt: skip
    angle = np.radians(gantry.detector_angle_deg)
    # From +z towards +y, as the tube turns.
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    pivot = [gantry.focal_spot_y_mm, gantry.pivot_to_detector_mm - gantry.support_to_detector_mm]
    return np.concatenate([flat[..., :1], arm @ turn.T + pivot], axis=-1)


def _bilinear(inverse, plane, point):
    u, v = inverse.frame.index(point)[:2]
    if not (0 <= u <= inverse.frame.shape[0] - 1 and 0 <= v <= inverse.frame.shape[1] - 1):
        return np.full(3, np.nan)
    i, j = min(int(u), inverse.frame.shape[0] - 2), min(int(v), inverse.frame.shape[1] - 2)
    corner = inverse.original_mm[i : i + 2, j : j + 2, plane].astype(float)
    along_y = corner[:, 0] * (1 - v + j) + corner[:, 1] * (v - j)
    return along_y[0] * (1 - u + i) + along_y[1] * (u - i)

"""A breast's outline in coarse voxels, for what is asked before the breast itself is made."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import ndimage

from mammosim.phantom.anatomy._outline_kernels import paint_outline
from mammosim.phantom.anatomy.body import (
    draw_body,
    lattice_of,
    open_end_of,
    paint_of,
    phantom_of,
    streams_of_breast,
    streams_of_woman,
)
from mammosim.phantom.anatomy.outline import GRID_MM
from mammosim.phantom.anatomy.parenchyma import (
    draw_parenchyma,
    gland_patches,
    gland_region,
    gland_room,
)
from mammosim.phantom.anatomy.settings import GenerateSettings
from mammosim.phantom.breast import BreastPhantom


def generate_outline(
    settings: GenerateSettings, seed: int = 1, laterality: Literal["L", "R"] = "L"
) -> BreastPhantom:
    """Make a breast without its fine structure, which takes a fraction of a second.

    Parameters
    ----------
    settings : GenerateSettings
        Of coarse voxels: the skin is as thick as it is on average, its surface in steps.
    seed : int
    laterality : {"L", "R"}

    Returns
    -------
    BreastPhantom
        Shape, muscle, nipple, open end and the room for gland are those of `generate_phantom`.
        Inside are fat and, in other patches, as much gland: stiffness is about right, places are
        not. There are no ducts, lobules, septa, vessels or findings.
    """
    body = draw_body(settings, seed, laterality)
    lattice, paint, frame = lattice_of(body, settings.voxel_mm), paint_of(body), body.frame
    field_rng = streams_of_breast(seed, laterality)[2]
    kind = draw_parenchyma(settings.density_class, streams_of_woman(seed)[1])
    room = gland_room(body.outline, kind, body.own_mm, body.behind_mm, frame, field_rng)
    breast = (body.depth_mm > body.skin_mm) & (body.own_mm > 0.0) & (body.muscle_mm < 0.0)
    room = gland_region(room, breast, kind.expanse * settings.target_percent / 100.0)
    foot_mm = body.outline.shape.depth_mm
    room = room + gland_patches(room, kind, foot_mm, frame, field_rng)
    axes = (lattice.x_mm, lattice.lateral_mm, lattice.superior_mm)
    at = np.meshgrid(
        *((axis - start) / GRID_MM for axis, start in zip(axes, frame.origin_mm, strict=True)),
        indexing="ij",
    )
    depth, own, muscle, gland = (
        ndimage.map_coordinates(field, at, order=1, mode="nearest")
        for field in np.broadcast_arrays(body.depth_mm, body.own_mm, body.muscle_mm, room)
    )
    inside = (depth > body.skin_mm) & (own > 0.0)
    within = np.sort(gland[inside & (muscle < 0.0)])
    # Fat within muscle counts as breast, as in `generate_phantom`.
    counted = within.size + body.muscle.fat * np.count_nonzero(inside & (muscle >= 0.0))
    fat = max(within.size - int(settings.target_percent / 100.0 * counted), 0)
    paint = paint._replace(threshold=float(within[min(fat, within.size - 1)]))
    labels = np.zeros(depth.shape, np.uint8)
    paint_outline(labels, lattice, paint, depth, muscle, gland, body.skin_mm, body.muscle.fat)
    end = open_end_of(body, laterality, body.skin_mm)
    return phantom_of(labels, lattice, body, settings, seed, laterality, end)

"""The breast in three dimensions for the report: skin, lesions, and plotly.js to turn them."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.targets import Target

RINGS, RAYS = 28, 48
"""Points of the skin's surface: from the chest wall to the nipple, and around."""

RAY_STEP_MM = 0.5
"""Distance at which rays are looked along for the skin, mm."""


@cache
def plotly_gzip_base64() -> str:
    """The library plotly.js (MIT licence), packed as the page carries it."""
    library = files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()
    # No time stamp: the same library gives the same page.
    return base64.b64encode(gzip.compress(library, 9, mtime=0)).decode("ascii")


def moved_skin(compressed: CompressedBreast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of the skin before compression, and by how much it moves them, [ring, ray, 3], mm."""
    surface = skin_surface(compressed.phantom)
    return surface, compressed.displacement_at(surface.reshape(-1, 3)).reshape(surface.shape)


def solid(
    skin: tuple[NDArray[np.float64], NDArray[np.float64]], targets: Sequence[Target]
) -> dict[str, Any]:
    """What the 3-D view of one view draws, breast frame, mm, in plain values.

    Parameters
    ----------
    skin : tuple of ndarray
        From `moved_skin`.
    targets : sequence of Target
        Of this view.

    Returns
    -------
    dict
        `skin` and `skin_shift`: x, y, z each [ring][ray]; `targets`: number, name, kind, place and
        shift of each.
    """
    surface, shift = skin
    return {
        "skin": [_plain(surface[..., axis]) for axis in range(3)],
        "skin_shift": [_plain(shift[..., axis]) for axis in range(3)],
        "targets": [
            {
                "number": "N" if target.kind == "nipple" else str(target.target_id),
                "name": target.name,
                "kind": target.kind,
                "place": _plain(target.place_mm),
                "shift": _plain(target.shift_vector_mm),
            }
            for target in targets
        ],
    }


def skin_surface(phantom: BreastPhantom) -> NDArray[np.float64]:
    """(ring, ray + 1, 3) points of the skin, breast frame, mm; the last ray is the first again.

    Notes
    -----
    On each of some planes parallel to the chest wall, the farthest tissue along rays from the
    middle of the plane's tissue. Folds that a ray passes twice are drawn filled.
    """
    layers = np.flatnonzero([plane.any() for plane in phantom.labels])
    # Closer together towards the nipple, where the breast narrows fastest.
    share = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, RINGS))
    chosen = layers[np.rint(share * (layers.size - 1)).astype(int)]
    return np.stack([_ring(phantom, int(x)) for x in chosen])


def _ring(phantom: BreastPhantom, x: int) -> NDArray[np.float64]:
    tissue = phantom.labels[x] > 0
    spacing = phantom.voxel_mm[1:]
    counts = [np.count_nonzero(tissue, axis=axis) for axis in (1, 0)]
    middle = np.array([np.average(np.arange(count.size), weights=count) for count in counts])
    angle = np.linspace(0.0, 2.0 * np.pi, RAYS + 1)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = np.arange(0.0, float(np.linalg.norm(tissue.shape * spacing)), RAY_STEP_MM)
    place = np.rint(middle + reach[:, None, None] * direction / spacing).astype(int)
    inside = ((place >= 0) & (place < tissue.shape)).all(axis=-1)
    place[~inside] = 0
    hit = inside & tissue[place[..., 0], place[..., 1]]
    farthest = np.where(hit, reach[:, None], 0.0).max(axis=0)
    index = middle + farthest[:, None] * direction / spacing
    return phantom.frame.position_mm(np.column_stack([np.full(RAYS + 1, float(x)), index]))


def _plain(values: NDArray[np.float64]) -> list[Any]:
    rounded: list[Any] = np.round(values, 1).tolist()
    return rounded

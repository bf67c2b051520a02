"""Where things are in a breast: tissue at a point, the box of all tissue, free places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from mammosim.errors import InputError
from mammosim.phantom.breast import BreastPhantom
from mammosim.tissues import TISSUES

COARSE_MM = 2.0
"""Grid on which free places are sought, mm: small against the lesions' distances."""

AVOIDED = ("air", "skin", "nipple", "muscle")
"""Tissues a drawn place keeps away from."""


def tissue_at(breast: BreastPhantom, position_mm: ArrayLike) -> str | None:
    """Tissue of the voxel that holds a point.

    Parameters
    ----------
    breast : BreastPhantom
    position_mm : array_like, (3,)
        Breast frame, mm.

    Returns
    -------
    str or None
        Name in the table of tissues; None outside the array.
    """
    index = np.rint(breast.frame.index(position_mm)).astype(int)
    if (index < 0).any() or (index >= breast.labels.shape).any():
        return None
    return breast.tissue_of_label[int(breast.labels[tuple(index)])]


def tissue_box_mm(breast: BreastPhantom) -> NDArray[np.float64]:
    """The box around all tissue.

    Parameters
    ----------
    breast : BreastPhantom

    Returns
    -------
    ndarray, (2, 3)
        Lowest and highest outer faces of the voxels that are not air, breast frame, mm.
    """
    low, high = np.full(3, np.iinfo(np.int64).max), np.full(3, -1)
    for layer, plane in enumerate(breast.labels):
        tissue = plane != 0
        rows = np.flatnonzero(tissue.any(axis=1))
        if rows.size:
            columns = np.flatnonzero(tissue.any(axis=0))
            low = np.minimum(low, [layer, rows[0], columns[0]])
            high = np.maximum(high, [layer, rows[-1], columns[-1]])
    half = 0.5 * breast.voxel_mm
    return np.stack([breast.frame.position_mm(low) - half, breast.frame.position_mm(high) + half])


def box_text(breast: BreastPhantom) -> str:
    """Where the breast is, in words.

    Parameters
    ----------
    breast : BreastPhantom

    Returns
    -------
    str
        The lowest and highest x, y and z of its tissue, breast frame, whole mm.
    """
    low, high = tissue_box_mm(breast)
    sides = [f"{axis} {low[n]:.0f} to {high[n]:.0f}" for n, axis in enumerate("xyz")]
    return f"the breast spans {', '.join(sides)} mm"


def draw_place(
    breast: BreastPhantom,
    radius_mm: float,
    taken: Sequence[tuple[NDArray[np.float64], float]],
    rng: np.random.Generator,
    name: str,
    arises_in: Sequence[Sequence[str]] = (),
) -> NDArray[np.float64]:
    """A random centre whose ball stays clear of skin, nipple, muscle and other lesions.

    Parameters
    ----------
    breast : BreastPhantom
    radius_mm : float
        Radius of the ball, mm.
    taken : sequence of (centre, radius)
        Balls already there, mm.
    rng : Generator
    name : str
        For messages.
    arises_in : sequence of sequence of str
        Tissues in which it arises: the first group of which there is any; where there is none,
        any tissue.

    Raises
    ------
    InputError
        If there is no such place.
    """
    stride = np.maximum(1, np.rint(COARSE_MM / breast.voxel_mm)).astype(int)
    coarse = breast.labels[tuple(slice(None, None, step) for step in stride)]
    spacing = breast.voxel_mm * stride
    avoided = np.isin(coarse, [TISSUES[tissue].label for tissue in AVOIDED])
    # Beyond the array lies air, except behind the chest wall where lesions must not go either.
    room = ndimage.distance_transform_edt(
        ~np.pad(avoided, 1, constant_values=True), sampling=spacing
    )
    room = room[1:-1, 1:-1, 1:-1]
    # Half a coarse voxel's diagonal: what the grid may have missed.
    free = room > radius_mm + 0.5 * float(np.linalg.norm(spacing))
    index = np.argwhere(free)
    centres = breast.origin_mm + index * spacing
    apart = np.ones(len(index), bool)
    if breast.open_end is not None:  # what only oblique views hold is no place for a lesion
        end = breast.open_end
        apart &= end.held_depth_at(centres) > radius_mm + end.skin_mm
    for centre, radius in taken:
        apart &= np.linalg.norm(centres - centre, axis=1) > radius + radius_mm + 1.0
    choices = _in_preferred(centres, apart, coarse[tuple(index.T)], arises_in)
    if len(choices) == 0:
        raise InputError(
            f"lesion '{name}': no place has room for its {2 * radius_mm:.1f} mm; without "
            f"other lesions the largest free space is {2 * float(room.max()):.1f} mm; give a "
            "smaller diameter_mm or a position_mm"
        )
    chosen: NDArray[np.float64] = choices[rng.integers(len(choices))]
    return chosen


def _in_preferred(
    centres: NDArray[np.float64],
    free: NDArray[np.bool_],
    labels: NDArray[np.uint8],
    arises_in: Sequence[Sequence[str]],
) -> NDArray[np.float64]:
    """Those free places that lie in the first group of tissues that there is, or else all."""
    for tissues in arises_in:
        within = free & np.isin(labels, [TISSUES[tissue].label for tissue in tissues])
        if within.any():
            return centres[within]
    return centres[free]

"""Where each lesion appears on the image: exact masks from the lesions' own path lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.projection import PathLengths
from mammosim.targets import Target


@dataclass(frozen=True, eq=False)
class LesionMask:
    """One lesion's shadow.

    Parameters
    ----------
    target : Target
    mask : ndarray of bool, [row, column]
        Pixels whose ray passes through the lesion.
    """

    target: Target
    mask: NDArray[np.bool_]


def lesion_masks(paths: PathLengths, targets: Sequence[Target]) -> list[LesionMask]:
    """Mask of every lesion channel, by rising target id.

    Parameters
    ----------
    paths : PathLengths
    targets : sequence of Target
        Targets of this view. Channel and target belong together by the lesion's name; lesions of
        one name by the order of their labels and ids.

    Returns
    -------
    list of LesionMask
        Empty where the breast has no lesion. A mask is all False where the lesion is not on the
        image.

    Raises
    ------
    InputError
        If a lesion channel has no target, or a lesion's target id is not a whole number from 1.
    """
    return [
        LesionMask(target, paths.length_mm[channel] > 0.0)
        for target, channel in lesion_channels(paths, targets)
    ]


def lesion_channels(paths: PathLengths, targets: Sequence[Target]) -> list[tuple[Target, int]]:
    """Target and channel of every lesion, by rising target id; as `lesion_masks` pairs them."""
    waiting: dict[str, list[Target]] = {}
    for target in sorted(targets, key=lambda target: target.target_id):
        if target.is_lesion:
            waiting.setdefault(target.name, []).append(target)
    channels = [channel for channel, label in enumerate(paths.lesion_labels) if label != 0]
    channels.sort(key=lambda channel: paths.lesion_labels[channel])
    found = [(_next_target(paths.tissues[channel], waiting), channel) for channel in channels]
    return sorted(found, key=lambda pair: pair[0].target_id)


def _next_target(name: str, waiting: dict[str, list[Target]]) -> Target:
    if not waiting.get(name):
        known = ", ".join(sorted(name for name, left in waiting.items() if left)) or "none"
        raise InputError(f"lesion '{name}' has no row among the targets; rows left over: {known}")
    target = waiting[name].pop(0)
    if target.target_id < 1:
        raise InputError(
            f"lesion '{name}': found target_id {target.target_id}, expected 1 or more, "
            "since 0 is the background of lesion_mask.tif"
        )
    return target


def label_image(masks: Sequence[LesionMask], shape: tuple[int, int]) -> NDArray[np.unsignedinteger]:
    """One picture of all masks, whose pixel value is the target id.

    Parameters
    ----------
    masks : sequence of LesionMask
    shape : (int, int)
        Rows and columns.

    Returns
    -------
    ndarray of uint8 or uint16, [row, column]
        0 where there is no lesion; where lesions overlap, the smaller one's id. 16 bits only
        where an id needs them.
    """
    highest = max((lesion.target.target_id for lesion in masks), default=0)
    image: NDArray[np.unsignedinteger] = np.zeros(shape, np.uint8 if highest < 256 else np.uint16)
    for lesion in sorted(masks, key=lambda lesion: -np.count_nonzero(lesion.mask)):
        image[lesion.mask] = lesion.target.target_id
    return image

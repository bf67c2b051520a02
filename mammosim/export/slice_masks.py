"""Which voxels of a reconstruction lie in each lesion, and the DICOM Segmentation of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike

import highdicom as hd
import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.uid import ExplicitVRLittleEndian

from mammosim.compression import CompressedBreast
from mammosim.export.derived_objects import place_in_study, settle
from mammosim.export.dicom_object import save_object
from mammosim.export.identity import StudyIdentity
from mammosim.export.segmentation import lesion_segmentation, set_dimensions
from mammosim.export.settings import ExportSettings
from mammosim.reconstruction import Reconstruction
from mammosim.targets import Target

STRETCH = 1.6
"""A compressed lesion is taken to reach no further than its uncompressed extent times this; breasts
are compressed to about half, so that tissue becomes about 1.4 times as wide."""

ROOM_MM = 2.0
"""Searched beside that, mm."""


@dataclass(frozen=True, eq=False)
class SliceMask:
    """One lesion in a reconstruction.

    Parameters
    ----------
    target : Target
    first : tuple of int
        Slice, row and column of the box's first voxel.
    mask : ndarray of bool, [slice, row, column]
        Voxels of a box whose centres lie in the lesion; may be empty or all False.
    """

    target: Target
    first: tuple[int, int, int]
    mask: NDArray[np.bool_]


def slice_masks(
    compressed: CompressedBreast, volume: Reconstruction, targets: Sequence[Target]
) -> list[SliceMask]:
    """The voxels of each lesion, by rising target id.

    Parameters
    ----------
    compressed : CompressedBreast
    volume : Reconstruction
    targets : sequence of Target
        Of this view, with their places in the volume.

    Notes
    -----
    The centres of voxels near a lesion are carried back to the uncompressed breast, whose labels
    say what is there.
    """
    waiting: dict[str, list[int]] = {}
    for lesion in sorted(compressed.phantom.lesions, key=lambda lesion: lesion.label):
        waiting.setdefault(lesion.name, []).append(lesion.label)
    found = []
    for target in sorted(targets, key=lambda target: target.target_id):
        if target.is_lesion and waiting.get(target.name):
            found.append(_mask_of(target, waiting[target.name].pop(0), compressed, volume))
    return found


def _mask_of(
    target: Target, label: int, compressed: CompressedBreast, volume: Reconstruction
) -> SliceMask:
    grid = volume.grid
    extent_mm = target.extent_mm if math.isfinite(target.extent_mm) else 0.0
    reach_mm = 0.5 * STRETCH * extent_mm + ROOM_MM
    middle = np.array([target.volume_slice, target.volume_row_px, target.volume_col_px])
    reach = reach_mm / np.array([grid.slice_mm, grid.pixel_mm, grid.pixel_mm])
    low = np.maximum(np.floor(middle - reach), 0).astype(int)
    high = np.minimum(np.ceil(middle + reach) + 1, grid.shape).astype(int)
    first = (int(low[0]), int(low[1]), int(low[2]))
    if np.any(high <= low):
        return SliceMask(target, first, np.zeros((0, 0, 0), np.bool_))
    mask = np.zeros(high - low, np.bool_)
    for number, plane in enumerate(mask):
        rows, columns = np.indices(plane.shape)
        voxels = np.stack(
            [np.full(plane.size, low[0] + number), rows.ravel() + low[1], columns.ravel() + low[2]],
            axis=-1,
        )
        there = volume.gantry.breast_from_gantry(grid.gantry_from_voxel(voxels))
        plane[:] = (_labels_at(compressed, there) == label).reshape(plane.shape)
    return SliceMask(target, first, mask)


def _labels_at(compressed: CompressedBreast, points_mm: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Labels of the uncompressed voxels that compressed points (n, 3) came from; 0 for none."""
    phantom = compressed.phantom
    found = np.zeros(len(points_mm), np.uint8)
    before = compressed.original_point(points_mm)
    known = np.isfinite(before).all(axis=1)
    index = np.rint(phantom.frame.index(before[known])).astype(int)
    inside = np.all((index >= 0) & (index < phantom.labels.shape), axis=1)
    there = np.flatnonzero(known)[inside]
    found[there] = phantom.labels[tuple(index[inside].T)]
    return found


def write_slice_masks(
    masks: Sequence[SliceMask],
    slices: Dataset,
    volume: Reconstruction,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write the masks as one binary DICOM Segmentation of the slices, a segment a lesion.

    Parameters
    ----------
    masks : sequence of SliceMask
        At least one of them with a voxel.
    slices : pydicom.Dataset
        The object of the slices, which the segmentation refers to.
    volume : Reconstruction
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    view, grid = volume.gantry.view, volume.grid
    occupied = sorted(
        {one.first[0] + int(k) for one in masks for k in np.flatnonzero(one.mask.any(axis=(1, 2)))}
    )
    pixels = np.zeros((len(occupied), *grid.shape[1:], len(masks)), np.bool_)
    for number, one in enumerate(masks):
        depth, rows, columns = one.mask.shape
        part = np.s_[one.first[1] : one.first[1] + rows, one.first[2] : one.first[2] + columns]
        for frame, slice_ in enumerate(occupied):
            if 0 <= slice_ - one.first[0] < depth:
                pixels[frame, :, :, number][part] = one.mask[slice_ - one.first[0]]
    shared = slices.SharedFunctionalGroupsSequence[0]
    places = [slices.PerFrameFunctionalGroupsSequence[k].PlanePositionSequence for k in occupied]
    segmentation = lesion_segmentation(
        slices,
        pixels,
        [one.target for one in masks],
        study,
        place_in_study(study, "slice segmentation", view),
        pixel_measures=hd.PixelMeasuresSequence.from_sequence(shared.PixelMeasuresSequence),
        plane_orientation=hd.PlaneOrientationSequence.from_sequence(
            shared.PlaneOrientationSequence
        ),
        plane_positions=[hd.PlanePositionSequence.from_sequence(place) for place in places],
        content_description="Where each simulated lesion is",
        transfer_syntax_uid=ExplicitVRLittleEndian,
    )
    settle(
        segmentation, study, settings, "slice segmentation", view, " lesions in slices",
        is_image=True,
    )  # fmt: skip
    set_dimensions(segmentation, study.uid("slice dimensions", view.folder))
    save_object(segmentation, path)

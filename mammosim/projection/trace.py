"""Projection of the compressed breast: length of each tissue on the ray to each pixel."""

from __future__ import annotations

import math
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.config import documents_keys, given_settings
from mammosim.geometry import Gantry
from mammosim.projection.channels import Channels, channels_of, host_channel
from mammosim.projection.detector_field import place_detector
from mammosim.projection.feasible import check_memory
from mammosim.projection.keys import ProjectionKeys
from mammosim.projection.paths import PathLengths
from mammosim.projection.ray_tracing import Beam, trace_rays
from mammosim.projection.settings import ProjectionSettings
from mammosim.projection.smoothing import smooth_voxels, stretched_voxel_mm
from mammosim.projection.voxel_map import VoxelMap, voxel_map


@documents_keys(ProjectionSettings, ProjectionKeys)
def project(
    compressed: CompressedBreast,
    settings: ProjectionSettings | None = None,
    **keys: Unpack[ProjectionKeys],
) -> PathLengths:
    """Project a compressed breast onto the detector.

    Parameters
    ----------
    compressed : CompressedBreast
    settings : ProjectionSettings, optional
        Detector and focal spot; or give its keys as keywords.
    **keys
        Keys of `ProjectionSettings`: ``pixel_mm``, ``source_to_detector_mm``,
        ``detector_edge_mm``, ``conserve_mass``, ...

    Returns
    -------
    PathLengths
        Lengths in mm, float32 [tissue, row, column].

    Raises
    ------
    InputError
        If a key is unknown or its value not allowed, no part of the breast is on the detector, or
        the image does not fit in memory.

    Notes
    -----
    A ray is cut where it crosses the planes of the inverse map. The ends of each piece are carried
    back to the uncompressed breast (bilinear in the plane) and joined by a straight line, along
    which the phantom's own voxels are met one by one (Siddon 1985, Med Phys 12:252; Amanatides
    and Woo 1987, Eurographics). A voxel gets the share of the piece's compressed length that the
    line has in it. With no displacement this is the exact projection of the voxels. The voxels
    are never resampled, and all channels come from one pass.

    Not modelled: size of the focal spot, bending of the ray's image within a cell of the inverse
    map (an error of second order in its spacing), scatter (see the acquisition room).
    """
    settings = given_settings(ProjectionSettings, settings, keys, "project")
    mapped = voxel_map(compressed)
    gantry, notes = place_detector(compressed, mapped, settings)
    channels = channels_of(compressed.phantom)
    check_memory(settings, (gantry.rows, gantry.columns), len(channels))
    return trace_onto(gantry, compressed, mapped, channels, settings, notes)


def trace_onto(
    gantry: Gantry,
    compressed: CompressedBreast,
    mapped: VoxelMap,
    channels: Channels,
    settings: ProjectionSettings,
    notes: tuple[str, ...] = (),
) -> PathLengths:
    """Path lengths onto one gantry's detector; its focal spot may be anywhere above the breast."""
    conserve_mass = settings.conserve_mass
    length, attenuating = trace_rays(
        compressed.phantom.labels, channels.of_label, len(channels) + len(channels.shares),
        mapped.nodes, _beam(gantry, mapped), weighted=conserve_mass,
    )  # fmt: skip
    same = attenuating is length
    length = _shared_out(length, channels)
    attenuating = length if same else _shared_out(attenuating, channels)
    attenuating = _filled(attenuating, length, compressed, channels)
    if settings.smooth_voxels and conserve_mass:
        voxel_mm = stretched_voxel_mm(mapped, compressed.phantom.voxel_mm)
        smooth_voxels(attenuating, channels, gantry, voxel_mm, compressed.thickness_mm)
    return PathLengths(
        tissues=channels.names,
        materials=channels.materials,
        lesion_labels=channels.lesion_labels,
        length_mm=length,
        attenuating_mm=attenuating,
        gantry=gantry,
        thickness_mm=compressed.thickness_mm,
        force_n=compressed.force_n,
        clipped_fraction=mapped.clipped_fraction if conserve_mass else 0.0,
        breast=compressed,
        notes=notes,
    )


def _shared_out(traced: NDArray[np.float32], channels: Channels) -> NDArray[np.float32]:
    """Lengths of the named channels, to which those of mixtures are added by their parts."""
    named = traced[: len(channels)]
    for mixture, shares in zip(traced[len(channels) :], channels.shares, strict=True):
        for channel in np.flatnonzero(shares):
            named[channel] += shares[channel] * mixture
    return named


def _beam(gantry: Gantry, mapped: VoxelMap) -> Beam:
    """The rays in grid units; the gantry's origin is the detector's edge at support height."""
    frame = mapped.frame
    origin = frame.origin_mm - gantry.origin_mm
    spot = (gantry.focal_spot_mm - origin) / frame.spacing_mm
    column_x = gantry.detector_mm(np.zeros(gantry.columns), np.arange(gantry.columns))[:, 0]
    row = gantry.detector_mm(np.arange(gantry.rows), np.zeros(gantry.rows))
    detector_k = float(row[:, 2].min() - origin[2]) / frame.spacing_mm[2]
    return Beam(
        float(spot[0]),
        float(spot[1]),
        float(spot[2]),
        (gantry.focal_spot_mm[2] - row[:, 2]) / frame.spacing_mm[2],
        max(0, math.ceil(detector_k)),
        np.asarray(frame.spacing_mm, dtype=np.float64),
        (row[:, 1] - origin[1]) / frame.spacing_mm[1],
        (column_x - origin[0]) / frame.spacing_mm[0],
    )


def _filled(
    attenuating: NDArray[np.float32],
    length: NDArray[np.float32],
    compressed: CompressedBreast,
    channels: Channels,
) -> NDArray[np.float32]:
    """Attenuating lengths with lesions that fill their voxels in part.

    The rest of such a lesion's length goes to the material around it.
    """
    for channel, lesion in enumerate(channels.lesions):
        if lesion is None or lesion.fill == 1.0:
            continue
        if attenuating is length:
            attenuating = length.copy()
        host = host_channel(compressed.phantom, lesion, channels)
        rows = np.flatnonzero(attenuating[channel].any(axis=1))
        if rows.size == 0:
            continue
        # Pages of zeros beside the lesion stay untouched, and so take no memory.
        part = np.s_[rows[0] : rows[-1] + 1]
        if host is not None:
            attenuating[host, part] += np.float32(1.0 - lesion.fill) * attenuating[channel, part]
        attenuating[channel, part] *= np.float32(lesion.fill)
    return attenuating

"""Projections of a compressed breast from an arc of tube positions, for tomosynthesis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

from mammosim.compression import CompressedBreast
from mammosim.config import documents_keys, given_settings, to_settings
from mammosim.geometry import Gantry
from mammosim.projection.channels import Channels, channels_of
from mammosim.projection.detector_field import place_detector, turned
from mammosim.projection.feasible import check_arc, check_gap, check_memory
from mammosim.projection.keys import ProjectionKeys, TomosynthesisKeys
from mammosim.projection.paths import PathLengths
from mammosim.projection.settings import ProjectionSettings, TomosynthesisSettings
from mammosim.projection.trace import trace_onto
from mammosim.projection.voxel_map import VoxelMap, voxel_map


@dataclass(frozen=True, eq=False)
class Arc:
    """A compressed breast, and the tube positions that it is projected from.

    Path lengths are traced one position at a time, when asked for: all of them together would
    not fit in memory.

    Parameters
    ----------
    compressed : CompressedBreast
    gantries : tuple of Gantry
        One per projection, with one detector.
    settings : TomosynthesisSettings
    notes : tuple of str
        Warnings, one sentence each.
    """

    compressed: CompressedBreast
    gantries: tuple[Gantry, ...]
    settings: TomosynthesisSettings
    _mapped: VoxelMap
    _channels: Channels
    _settings: ProjectionSettings
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.gantries)

    @property
    def middle(self) -> int:
        """Index of the projection nearest to the upright tube (the later of two)."""
        return len(self) // 2

    def paths(self, index: int) -> PathLengths:
        """Path lengths of one projection."""
        return trace_onto(
            self.gantries[index],
            self.compressed,
            self._mapped,
            self._channels,
            self._settings,
            self.notes,
        )


@documents_keys(ProjectionSettings, ProjectionKeys)
def project_arc(
    compressed: CompressedBreast,
    tomosynthesis: TomosynthesisSettings | TomosynthesisKeys | None = None,
    settings: ProjectionSettings | None = None,
    **keys: Unpack[ProjectionKeys],
) -> Arc:
    """Prepare the projections of a compressed breast from an arc of tube positions.

    Parameters
    ----------
    compressed : CompressedBreast
    tomosynthesis : TomosynthesisSettings or dict of its keys, optional
        How the tube moves; without a view, it is that of `compressed`.
    settings : ProjectionSettings, optional
        Detector and focal spot; or give its keys as keywords.
    **keys
        Keys of `ProjectionSettings`.

    Returns
    -------
    Arc

    Raises
    ------
    InputError
        As `project`.

    Notes
    -----
    The focal spot is at ``y = y0 + (SID - h) sin(angle)`` and ``SID - (1 - cos(angle)) (SID - h)``
    above the detector plane, h being the pivot's height. The breast does not move; the detector
    stays too, or turns about the pivot in proportion to the tube.
    """
    settings = given_settings(ProjectionSettings, settings, keys, "project_arc")
    if isinstance(tomosynthesis, TomosynthesisSettings):
        sweep = tomosynthesis
    else:
        given = {"view": compressed.view.name, **(tomosynthesis or {})}
        sweep = to_settings(TomosynthesisSettings, given, "project_arc")
    check_arc(sweep, settings)
    mapped, channels = voxel_map(compressed), channels_of(compressed.phantom)
    upright, notes = place_detector(compressed, mapped, settings, sweep)
    shape = upright.rows, upright.columns
    check_memory(settings, shape, len(channels), sweep.projections)
    gantries = tuple(turned(upright, angle, sweep) for angle in sweep.angles_deg)
    check_gap(gantries)
    return Arc(compressed, gantries, sweep, mapped, channels, settings, notes)

"""Lesions put into a breast before it is compressed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.breast import BreastPhantom, Lesion
from mammosim.phantom.lesion_kinds import (
    LESION_KINDS,
    LesionForm,
    Site,
    distance_mm,
    window_around,
)
from mammosim.phantom.lesion_pieces import bounding_box
from mammosim.phantom.lesion_shapes import paint_shape, read_shape
from mammosim.phantom.place import box_text, draw_place, tissue_at
from mammosim.phantom.settings import LesionSettings
from mammosim.tissues import LESION_LABELS

Taken = list[tuple[NDArray[np.float64], float]]


@dataclasses.dataclass(frozen=True, eq=False)
class PlannedLesion:
    """A lesion with its form and size, of its kind or of its file.

    Parameters
    ----------
    settings : LesionSettings
    form : LesionForm
    size_mm : float
        Diameter of the ball around it, mm.
    """

    settings: LesionSettings
    form: LesionForm
    size_mm: float

    @property
    def name(self) -> str:
        """Name of the lesion."""
        return self.settings.name


def insert_lesions(
    breast: BreastPhantom,
    lesions: Sequence[LesionSettings],
    rng: np.random.Generator,
    in_place: bool = False,
) -> BreastPhantom:
    """Put lesions into a breast.

    Parameters
    ----------
    breast : BreastPhantom
        Left as it is, its labels copied once, unless `in_place`.
    lesions : sequence of LesionSettings
    rng : Generator
        Draws places that are not given, outlines, and calcifications.
    in_place : bool
        Paint into the breast's own labels, for a breast that is not used any further.

    Returns
    -------
    BreastPhantom
        With one more lesion, with a label of its own, for each setting.

    Raises
    ------
    InputError
        Every lesion that lies outside the breast, overlaps another or does not fit, and names
        used twice.
    """
    if not lesions:
        return breast
    free = [label for label in LESION_LABELS if label not in {le.label for le in breast.lesions}]
    problems = _name_problems(breast, lesions)
    planned, shape_problems = _planned(lesions)
    problems += shape_problems
    if len(lesions) > len(free):
        problems.append(
            f"phantom.lesions: found {len(lesions)}, at most {len(free)} can be distinguished"
        )
    if problems:
        raise InputError(problems)
    taken = [_ball_around(breast, lesion) for lesion in breast.lesions]
    centres = _centres(breast, planned, taken, rng)
    labels = breast.labels if in_place else breast.labels.copy()
    made = list(breast.lesions)
    own = rng.spawn(len(lesions))
    for entry, centre, label, lesion_rng in zip(planned, centres, free, own, strict=False):
        made.append(_painted(breast, labels, entry, centre, label, lesion_rng))
    tissue_of_label = dict(breast.tissue_of_label)
    tissue_of_label.update({lesion.label: lesion.tissue for lesion in made})
    return dataclasses.replace(
        breast, labels=labels, lesions=tuple(made), tissue_of_label=tissue_of_label
    )


def plan_lesions(lesions: Sequence[LesionSettings]) -> list[PlannedLesion]:
    """Each lesion with its form and size.

    Raises
    ------
    InputError
        With one line per lesion whose file cannot be used.
    """
    planned, problems = _planned(lesions)
    if problems:
        raise InputError(problems)
    return planned


def _planned(lesions: Sequence[LesionSettings]) -> tuple[list[PlannedLesion], list[str]]:
    """Each lesion with its form, and what is wrong with their files."""
    planned, problems = [], []
    for number, entry in enumerate(lesions):
        try:
            planned.append(_plan(entry))
        except InputError as error:
            problems += [f"phantom.lesions.{number}.file: {line}" for line in error.problems]
    return planned, problems


def _plan(entry: LesionSettings) -> PlannedLesion:
    form = LESION_KINDS[entry.kind].form(entry)
    if entry.file is not None:
        shape = read_shape(entry.file, entry.voxel_mm)
        turns = entry.rotation_deg or (0.0, 0.0, 0.0)

        def paint(site: Site, keys: LesionSettings, rng: np.random.Generator) -> float:
            return paint_shape(site, shape, turns)

        form = dataclasses.replace(
            form, diameter_mm=2.0 * shape.radius_mm, paint=paint, room_mm=None
        )
    return PlannedLesion(entry, form, entry.diameter_mm or form.diameter_mm)


def _painted(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    entry: PlannedLesion,
    centre_mm: NDArray[np.float64],
    label: int,
    rng: np.random.Generator,
) -> Lesion:
    """Label a lesion's voxels, in place, and describe it from the voxels that it got."""
    site = Site(breast, labels, entry.name, centre_mm, 0.5 * entry.size_mm, label)
    true_mm3 = entry.form.paint(site, entry.settings, rng)
    corner, window = window_around(breast, centre_mm, site.radius_mm + 2.0, labels)
    index = np.argwhere(window == label)
    painted_mm3 = len(index) * float(np.prod(breast.voxel_mm))
    position = breast.frame.position_mm(corner + index.mean(axis=0))
    volume = painted_mm3 if true_mm3 is None else true_mm3
    fill = 1.0 if true_mm3 is None else min(1.0, true_mm3 / painted_mm3)
    kind = entry.settings.kind
    tissue = LESION_KINDS[kind].tissue
    return Lesion(entry.name, kind, label, tissue, position, min(volume, painted_mm3), fill)


def _name_problems(breast: BreastPhantom, lesions: Sequence[LesionSettings]) -> list[str]:
    names = [there.name for there in breast.lesions] + [entry.name for entry in lesions]
    twice = sorted({name for name in names if names.count(name) > 1})
    return [f"phantom.lesions: the name '{name}' is used more than once" for name in twice]


def _ball_around(breast: BreastPhantom, lesion: Lesion) -> tuple[NDArray[np.float64], float]:
    """Centre and radius, mm, of a ball as wide as a lesion that is there already."""
    box = bounding_box(breast.labels, lesion.label)
    if box is None:
        return lesion.position_mm, 0.0
    low = np.array([side.start for side in box])
    high = np.array([side.stop for side in box])
    radius = 0.5 * float(((high - low) * breast.voxel_mm).max())
    return breast.frame.position_mm(0.5 * (low + high - 1)), radius


def _centres(
    breast: BreastPhantom,
    lesions: Sequence[PlannedLesion],
    taken: Taken,
    rng: np.random.Generator,
) -> list[NDArray[np.float64]]:
    """Centre of each lesion: given ones are checked first, so that drawn ones keep clear."""
    problems: list[str] = []
    names = [lesion.name for lesion in breast.lesions]
    centres: dict[int, NDArray[np.float64]] = {}
    for number, entry in enumerate(lesions):
        if entry.settings.position_mm is None:
            continue
        centre, radius = np.array(entry.settings.position_mm), 0.5 * entry.size_mm
        problems += _outside(breast, entry, centre, number)
        for other, (there, extent) in zip(names, taken, strict=True):
            if float(np.linalg.norm(there - centre)) < radius + extent:
                problems.append(
                    f"phantom.lesions.{number}: '{entry.name}' ({entry.size_mm:g} mm at "
                    f"{list(entry.settings.position_mm)} mm) overlaps '{other}'"
                )
        centres[number] = centre
        names.append(entry.name)
        taken.append((centre, radius))
    if problems:
        raise InputError(problems)
    for number, entry in enumerate(lesions):
        if number not in centres:
            radius = 0.5 * entry.size_mm
            room = radius if entry.form.room_mm is None else entry.form.room_mm
            centres[number] = draw_place(breast, room, taken, rng, entry.name, entry.form.arises_in)
            taken.append((centres[number], radius))
    return [centres[number] for number in range(len(lesions))]


def _outside(
    breast: BreastPhantom, entry: PlannedLesion, centre: NDArray[np.float64], number: int
) -> list[str]:
    """What is wrong with a given position."""
    start = f"phantom.lesions.{number}: '{entry.name}' at {centre.tolist()} mm"
    if tissue_at(breast, centre) in (None, "air"):
        return [f"{start} lies outside the breast; {box_text(breast)}"]
    corner, window = window_around(breast, centre, 0.5 * entry.size_mm)
    inside = distance_mm(breast, corner, window.shape, centre) <= 0.5 * entry.size_mm
    low = breast.frame.index(centre) * breast.voxel_mm + 0.5 * breast.voxel_mm
    room = np.minimum(low, np.array(breast.labels.shape) * breast.voxel_mm - low).min()
    if (window[inside] == 0).any() or room < 0.5 * entry.size_mm:
        return [
            f"{start} extends beyond the breast with its {entry.size_mm:g} mm; move it inwards or "
            f"make it smaller; {box_text(breast)}"
        ]
    return []

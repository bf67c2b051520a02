"""Which breasts a configuration is about, and whether all its parts agree on it."""

from __future__ import annotations

from collections.abc import Sequence

from mammosim.phantom import PhantomSettings, Side
from mammosim.pipeline.configuration.view_settings import ViewSettings


def named_sides(
    laterality: Side | tuple[Side, Side] | None, phantom: PhantomSettings
) -> tuple[Side, ...]:
    """The sides that a configuration names, in order; empty where the phantom is to show its side.

    Where `laterality` is left out, the sides of the files are those of the exam, right first.
    """
    if laterality is not None:
        return laterality if isinstance(laterality, tuple) else (laterality,)
    if isinstance(phantom.file, dict):
        return tuple(sorted(phantom.file, reverse=True))
    return ()


def side_problems(
    sides: tuple[Side, ...], phantom: PhantomSettings, views: Sequence[ViewSettings]
) -> list[str]:
    """What contradicts the sides of an exam, one line each: files, lesions, landmarks and views."""
    return [
        *_file_problems(sides, phantom),
        *_entry_problems(sides, phantom),
        *_view_problems(sides, views),
    ]


def _file_problems(sides: tuple[Side, ...], phantom: PhantomSettings) -> list[str]:
    file = phantom.file
    if isinstance(file, str) and len(sides) > 1:
        return [
            f"phantom.file: found {file!r:.200} for both breasts, expected one file per side, as "
            "{L: left.mhd, R: right.mhd}"
        ]
    if isinstance(file, dict) and set(file) != set(sides):
        found = ", ".join(sorted(file))
        return [
            f"phantom.file: found files for {found}, expected one for each side of laterality: "
            f"{', '.join(sides)}"
        ]
    return []


def _entry_problems(sides: tuple[Side, ...], phantom: PhantomSettings) -> list[str]:
    """Lesions and landmarks in a breast that is not there."""
    problems = []
    for key in ("lesions", "landmarks"):
        for number, entry in enumerate(getattr(phantom, key)):
            if entry.laterality is not None and entry.laterality not in sides:
                problems.append(
                    f"phantom.{key}.{number}.laterality: found {entry.laterality} for "
                    f"'{entry.name}', {_imaged(sides)}"
                )
    return problems


def _view_problems(sides: tuple[Side, ...], views: Sequence[ViewSettings]) -> list[str]:
    """Views of a breast that is not there, breasts without views, and folders used twice."""
    problems = [
        f"views.{number}.laterality: found {view.laterality}, {_imaged(sides)}"
        for number, view in enumerate(views)
        if view.laterality is not None and view.laterality not in sides
    ]
    twice: dict[str, None] = {}
    for side in sides or (None,):
        labels = [view.label for view in views if view.laterality in (side, None)]
        if not labels:
            problems.append(f"views: none of them is of laterality {side}, expected at least one")
        folded = [label.casefold() for label in labels]
        twice.update(dict.fromkeys(la for la in labels if folded.count(la.casefold()) > 1))
    if twice:
        problems.append(
            f"views: {', '.join(sorted(twice))} is listed twice; each view may be listed once, or "
            "again under its own name, as {view: CC, name: CC_spot}"
        )
    return problems


def _imaged(sides: tuple[Side, ...]) -> str:
    if not sides:
        return "but which breast is imaged is not known; set laterality"
    return f"but only {sides[0]} is imaged" if len(sides) == 1 else "expected L or R"

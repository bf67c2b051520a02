"""The summary page of a cohort: how many, how they are distributed, and what failed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from mammosim._wording import counted
from mammosim.acquisition import dose_limit_mgy
from mammosim.plausibility import patients_beyond
from mammosim.report.contact_sheet import Thumbnails
from mammosim.report.figures import drawing_svg
from mammosim.report.quantities import key_in_words
from mammosim.report.realism import PUBLISHED
from mammosim.report.templates import template

A_VIEW = (
    ("thickness_mm", "Compressed thickness", "mm"),
    ("force_n", "Compression force", "N"),
    ("dose_mgy", "Mean glandular dose", "mGy"),
    ("volumetric_density_percent", "Volumetric density", "%"),
    ("mas", "Tube load", "mAs"),
)
"""Numbers of a view: column, heading, unit."""

A_LESION = (
    ("shift_mm", "Shift of lesions by compression", "mm"),
    ("volume_mm3", "Volume of lesions", "mm³"),
    ("skin_depth_mm", "Depth of lesions below the skin", "mm"),
    ("image_nipple_distance_mm", "Distance of lesions to the nipple on the picture", "mm"),
)
"""Numbers of a lesion in a view."""

MAX_LISTED = 200
"""Warnings, and failures, that the page lists; their files have all."""

_NO_LESION = ("nipple", "landmark")
_BARS, _RANGE = "#3b82c4", "#4f9a5b"  # legible on white and on near-black


def render_cohort(
    title: str,
    table: Mapping[str, Sequence[Any]],
    drawn: Mapping[str, Sequence[Any]],
    failures: Sequence[tuple[int, str]],
    sheet: Sequence[Thumbnails] = (),
    warnings: Mapping[int, Sequence[str]] = MappingProxyType({}),
    links: Mapping[int, str] = MappingProxyType({}),
) -> str:
    """Make the page, self-contained.

    Parameters
    ----------
    title : str
    table : mapping of str to sequence
        Columns of the cohort's table.
    drawn : mapping of str to sequence
        Columns whose values were drawn for each patient, and the order of those that are chosen
        from a list; empty for others.
    failures : sequence of (int, str)
        Number and reason of each patient that failed.
    sheet : sequence of Thumbnails
        Pictures to show.
    warnings : mapping of int to sequence of str
        Warnings of each patient that is there.
    links : mapping of int to str
        Path of each patient's report from the cohort's folder, where there is one.

    Returns
    -------
    str
        HTML.
    """
    patient = np.array(table["patient"])
    lesion = ~np.isin(np.array(table["kind"]), _NO_LESION)
    first_of_patient = np.unique(patient, return_index=True)[1]
    pictures = [
        f"{number}/{side}{name}"
        for number, side, name in zip(patient, table["laterality"], table["view"], strict=True)
    ]
    first_of_view = np.unique(pictures, return_index=True)[1]
    rows: list[list[str]] = []
    groups: list[tuple[str, Sequence[tuple[str, str, str]], NDArray[np.intp], str]] = [
        ("Sampled inputs", _in_words(drawn), first_of_patient, "patients"),
        ("Views", A_VIEW, first_of_view, "pictures"),
        ("Lesions", A_LESION, np.flatnonzero(lesion), "lesions in a view"),
    ]
    shown = []
    for heading, columns, some, what in groups:
        plots = []
        for column, name, unit in columns:
            values = [table[column][place] for place in some if table[column][place] is not None]
            if not values:
                continue
            label = f"{name}, {unit}" if unit else name
            plots.append(_plot(column, values, label, what, drawn.get(column, ())))
            if _are_numbers(values):
                rows.append([label, *_statistics(np.array(values, float))])
        if heading == "Views":
            plots += _dose_against_thickness(table, first_of_view)
        shown.append((heading, plots))
    return template("cohort.html").render(
        title=title,
        counts=[
            counted(first_of_patient.size, "patient"),
            counted(first_of_view.size, "picture"),
            f"{counted(int(lesion.sum()), 'lesion')} seen in a view each",
            f"{counted(len(failures), 'patient')} failed",
        ],
        groups=shown, rows=rows, failures=failures, most=MAX_LISTED, links=links, sheet=sheet,
        warned=patients_beyond(warnings),
        warnings=[(index, text) for index, found in warnings.items() for text in found],
    )  # fmt: skip


def _in_words(columns: Iterable[str]) -> list[tuple[str, str, str]]:
    """Column, heading and no unit of sampled keys; headings that read alike also name the key."""
    named = {column: key_in_words(column) for column in columns}
    alike = Counter(named.values())
    return [
        (column, f"{name} ({column})" if alike[name] > 1 else name, "")
        for column, name in named.items()
    ]


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(type(value) in (int, float) for value in values)


def _statistics(values: NDArray[np.float64]) -> list[str]:
    deviation = values.std(ddof=1) if values.size > 1 else math.nan
    numbers = (values.mean(), deviation, values.min(), np.median(values), values.max())
    return [str(values.size), *(f"{number:.4g}" for number in numbers)]


def _plot(
    column: str, values: Sequence[Any], label: str, what: str, order: Sequence[Any]
) -> dict[str, Any]:
    """A histogram of numbers, or bars of what is no number, in the order of its list."""
    low, high, source = PUBLISHED.get(column, (math.nan, math.nan, ""))

    def draw(axes: Any) -> None:
        from matplotlib.ticker import MaxNLocator

        if source:
            axes.axvspan(low, high, color=_RANGE, alpha=0.18, linewidth=0)
        if _are_numbers(values):
            axes.hist(np.array(values, float), bins=min(40, max(5, round(len(values) ** 0.5))),
                      color=_BARS)  # fmt: skip
        else:
            counts = Counter(str(value)[:24] for value in values)
            names = list(dict.fromkeys(str(value)[:24] for value in (*order, *sorted(counts))))
            axes.bar(names, [counts[name] for name in names], color=_BARS)
            if len(names) > 3:
                axes.tick_params(axis="x", labelrotation=30)
        axes.set_xlabel(label)
        axes.set_ylabel(what)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))

    published = f"Shaded: published range ({source})" if source else ""
    return _drawn(draw, f"{what} by {label}", column, published)


def _dose_against_thickness(
    table: Mapping[str, Sequence[Any]], some: NDArray[np.intp]
) -> list[dict[str, Any]]:
    """Dose of each picture against its thickness, and the acceptable level."""
    pairs = [(table["thickness_mm"][place], table["dose_mgy"][place]) for place in some]
    known = [pair for pair in pairs if None not in pair]
    if not known:
        return []
    thickness, dose = np.array(known, float).T

    def draw(axes: Any) -> None:
        across = np.linspace(min(20.0, thickness.min()), max(90.0, thickness.max()), 100)
        limits = [dose_limit_mgy(float(one)) for one in across]
        axes.plot(across, limits, color=_RANGE, label="acceptable level")
        axes.plot(thickness, dose, "o", markersize=3.5, color=_BARS, label="picture")
        axes.set_xlabel("Compressed thickness, mm")
        axes.set_ylabel("Mean glandular dose, mGy")
        axes.set_ylim(bottom=0.0)
        axes.legend(frameon=False, fontsize=8)

    source = "Line: acceptable level of the European guidelines, 4th edition"
    return [_drawn(draw, "Mean glandular dose against compressed thickness", "dose", source)]


def _drawn(draw: Callable[[Any], None], alt: str, name: str, note: str) -> dict[str, Any]:
    """A drawing for the page; Matplotlib escapes its text."""
    plain = "".join(letter if letter.isalnum() else "-" for letter in name)
    return {"alt": alt, "svg": Markup(drawing_svg(draw, f"plot-{plain}", (4.2, 2.6))), "note": note}

"""The summary page of a cohort: how many, how they are distributed, and what failed."""

from __future__ import annotations

import base64
import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import jinja2
import numpy as np
from numpy.typing import NDArray

from mammosim.plausibility import patients_beyond
from mammosim.report.contact_sheet import Thumbnails

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

MOST_LISTED = 200
"""Warnings, and failures, that the page lists; their files have all."""

_NO_LESION = ("nipple", "landmark")

_PAGE = jinja2.Template(
    """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{{ title|e }}</title>
<style>
body{font:16px/1.5 system-ui,sans-serif;color:#1b1f24}
body{max-width:72rem;margin:2rem auto;padding:0 1rem}
h1,h2{font-weight:600;line-height:1.2} h2{margin-top:2.5rem}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .8rem .2rem 0;text-align:right;border-bottom:1px solid #d8dee4}
th:first-child,td:first-child,td.text{text-align:left}
.sheet{display:flex;flex-wrap:wrap;gap:.8rem;padding:.8rem;background:#0b0d10}
.sheet figure{margin:0} .sheet img{width:auto;height:200px;display:inline-block}
.sheet figcaption,.sheet a{color:#c9d1d9;font-size:.8rem}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:1rem}
img{width:100%} p.quiet{color:#57606a}
</style>
<h1>{{ title|e }}</h1>
<p>{{ patients }} patients, {{ pictures }} pictures, {{ lesions }} lesions seen in a view each;
{{ failures|length }} patients failed.</p>
{% if sheet %}<h2>The first pictures</h2>
<div class="sheet">{% for shown in sheet %}<figure>{% for name, uri in shown.pictures %}
<img alt="patient {{ shown.patient }}, {{ name|e }}" src="{{ uri }}">{% endfor %}
<figcaption>{% if shown.link %}<a href="{{ shown.link|e }}">patient {{ shown.patient }}</a>
{%- else %}patient {{ shown.patient }}{% endif %}</figcaption></figure>{% endfor %}</div>{% endif %}
{% for heading, plots in groups if plots %}<h2>{{ heading }}</h2>
<div class="plots">{% for plot in plots %}
<img alt="{{ plot.alt|e }}" src="data:image/png;base64,{{ plot.png }}">
{% endfor %}</div>{% endfor %}
<h2>In numbers</h2>
<table><tr><th>quantity<th>number<th>mean<th>standard deviation
<th>smallest<th>median<th>largest</tr>
{% for row in rows %}<tr>{% for cell in row %}<td>{{ cell|e }}{% endfor %}</tr>
{% endfor %}</table>
{% if warnings %}<h2>Warnings</h2><table><tr><th>plausibility limit<th>patients</tr>
{% for name, count in warned.items() %}<tr><td>{{ name|e }}<td>{{ count }}</tr>
{% endfor %}</table>
<table><tr><th>patient<th style="text-align:left">warning</tr>
{% for index, text in warnings[:most] %}<tr><td>{{ index }}<td class="text">{{ text|e }}</tr>
{% endfor %}</table>{% if warnings|length > most %}<p class="quiet">The first {{ most }} of
{{ warnings|length }}; warnings.csv has all.</p>{% endif %}{% endif %}
{% if failures %}<h2>Failures</h2><table><tr><th>patient<th style="text-align:left">reason</tr>
{% for index, reason in failures[:most] %}<tr><td>{{ index }}<td class="text">{{ reason|e }}</tr>
{% endfor %}</table>{% if failures|length > most %}<p class="quiet">The first {{ most }} of
{{ failures|length }}; failures.csv has all.</p>{% endif %}{% endif %}
<p class="quiet">Simulated. Every number is in table.parquet and table.csv.</p></html>
""",
    autoescape=False,
)


def render_cohort(
    title: str,
    table: Mapping[str, Sequence[Any]],
    drawn: Mapping[str, Sequence[Any]],
    failures: Sequence[tuple[int, str]],
    sheet: Sequence[Thumbnails] = (),
    warnings: Mapping[int, Sequence[str]] = MappingProxyType({}),
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
    groups = [
        ("What was drawn", [(name, name, "") for name in drawn], first_of_patient, "patients"),
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
            plots.append(_plot(values, label, what, drawn.get(column, ())))
            if _are_numbers(values):
                rows.append([label, *_statistics(np.array(values, float))])
        shown.append((heading, plots))
    return _PAGE.render(
        title=title, patients=first_of_patient.size, pictures=first_of_view.size,
        lesions=int(lesion.sum()), groups=shown, rows=rows, failures=failures, most=MOST_LISTED,
        sheet=sheet, warned=patients_beyond(warnings),
        warnings=[(index, text) for index, found in warnings.items() for text in found],
    )  # fmt: skip


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(type(value) in (int, float) for value in values)


def _statistics(values: NDArray[np.float64]) -> list[str]:
    deviation = values.std(ddof=1) if values.size > 1 else math.nan
    numbers = (values.mean(), deviation, values.min(), np.median(values), values.max())
    return [str(values.size), *(f"{number:.4g}" for number in numbers)]


def _plot(values: Sequence[Any], label: str, what: str, order: Sequence[Any]) -> dict[str, str]:
    """A histogram of numbers, or bars of what is no number, in the order of its list."""
    import matplotlib as mpl  # a second of start-up that single runs need not wait for
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(4.2, 2.6), layout="constrained")
    axes = figure.subplots()
    if _are_numbers(values):
        axes.hist(np.array(values, float), bins=min(40, max(5, round(len(values) ** 0.5))),
                  color="#3b6ea5")  # fmt: skip
    else:
        counts = Counter(str(value)[:24] for value in values)
        names = list(dict.fromkeys(str(value)[:24] for value in (*order, *sorted(counts))))
        axes.bar(names, [counts[name] for name in names], color="#3b6ea5")
        if len(names) > 3:
            axes.tick_params(axis="x", labelrotation=30)
    axes.set_xlabel(label)
    axes.set_ylabel(what)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.spines[["top", "right"]].set_visible(False)
    stream = io.BytesIO()
    with mpl.rc_context({"font.size": 9}):
        figure.savefig(stream, format="png", dpi=140)
    return {"alt": f"{what} by {label}", "png": base64.b64encode(stream.getvalue()).decode()}

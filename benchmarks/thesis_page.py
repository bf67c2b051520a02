"""The page docs/explanation/thesis.md and its pictures, from what `benchmarks/thesis.py` found.

Only the text in `thesis.md.jinja` is written by hand; every number of ours comes from
results.json, every number of the thesis from the tables below.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt

PUBLISHED_FITS = {
    "100-15": (0.0011, 5.6539), "95-20": (0.001, 5.9016), "90-25": (0.0011, 6.0898),
    "85-30": (0.0011, 6.3369), "80-35": (0.0011, 6.4975),
}  # fmt: skip
"""Table 3.4.1: a and b of each case."""

PUBLISHED_AVERAGE = (0.0011, 6.0959)
"""Table 3.4.1, last row, and formula 3.4.6."""

PUBLISHED_NODES = 209_980
"""Number of nodes with which formula 3.4.7 gives Table 3.4.4; the thesis does not print it."""

PUBLISHED_TIMES = (
    (200, 0.7, 1.54277), (500, 1.7, 1.10914), (1000, 3.4, 0.63992), (2000, 6.9, 0.21301),
    (3500, 12.0, 0.04091), (5000, 17.1, 0.00786), (10000, 34.3, 0.00003),
)  # fmt: skip
"""Table 3.4.4: loops, hours, deviation in units."""

PUBLISHED_REVERSE = (
    (100, 1.948, None, None, None), (250, 1.624, 1.066, 0.0025, 7.7555),
    (500, 1.207, 0.754, 0.0021, 7.6803), (1000, 0.699, 0.567, 0.0015, 7.4639),
    (2000, 0.283, 0.227, 0.0012, 7.319), (4000, 0.075, 0.058, 0.0009, 7.0185),
    (6000, 0.041, 0.017, 0.0008, 6.6873), (8000, 0.021, 0.006, 0.0007, 6.4355),
)  # fmt: skip
"""Table 3.5.1: loops, calculated and estimated deviation in units, a, b."""

COLOURS = {"x": "#0072b2", "y": "#009e73", "z": "#d55e00"}
"""Of Okabe & Ito's palette (2008), which readers of any colour vision tell apart."""


def write_page(results: Path) -> None:
    """Write the page beside the folder of the results, and the pictures into it."""
    found = json.loads(results.read_text(encoding="utf-8"))
    folder = results.parent
    with plt.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        for draw in (draw_convergence, draw_section, draw_reverse, draw_time, draw_starts):
            figure = draw(found)
            name = draw.__name__.removeprefix("draw_")
            figure.savefig(folder / f"{name}.png", dpi=110, metadata={"Software": None})
            plt.close(figure)
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(
        loader=loader, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True, autoescape=False,
    )  # fmt: skip
    environment.filters.update(number=number, nodes=lambda count: f"{count:,}".replace(",", " "))
    page = environment.get_template("thesis.md.jinja").render(**page_values(found))
    (folder.parent / "thesis.md").write_text(page, encoding="utf-8")


def number(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, plain where that is short; a dash for none."""
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0 or 1e-4 <= abs(value) < 1e5:
        decimals = 0 if value == 0 else max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
        return f"{value:.{decimals}f}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10^{int(exponent)}"


def page_values(found: dict[str, Any]) -> dict[str, Any]:
    """What the template needs beyond the results themselves."""
    cases, reverse, starts = found["compression"], found["reverse"], found["starts"]
    middle = cases[starts["case"]]
    return {
        "cases": cases,
        "middle": middle,
        "middle_name": starts["case"],
        "reverse": reverse,
        "starts": starts,
        "machine": found["machine"],
        "times": found["times"],
        "fits": PUBLISHED_FITS,
        "average": PUBLISHED_AVERAGE,
        "average_of": average_fit(cases),
        "time_rows": time_rows(cases, middle, found["times"]["sweep_seconds"]),
        "reverse_rows": list(zip(PUBLISHED_REVERSE, reverse["stops"], strict=True)),
        "implied_nodes": [implied_nodes(*row) for row in PUBLISHED_REVERSE if row[2]],
        "sweep_range": [f(case["sweeps"] for case in cases.values()) for f in (min, max)],
        "left_range": [
            min(case["stops"][-1]["mean"] for case in cases.values()),
            max(case["stops"][-1]["mean"] for case in cases.values()),
            max(case["stops"][-1]["largest"] for case in cases.values()),
        ],
        "published_criterion": sweeps_to(reverse["curve"], 1e-4 * PUBLISHED_NODES),
        "early": next(row for row in reverse["stops"] if row["sweeps"] == 500),
        "last": lambda case: case["stops"][-1],
        "nipples": [f"{case['moved_exact']['nipple']:.1f}" for case in cases.values()],
        "ball": ball_figures(cases),
    }


def average_fit(cases: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Mean a and b over the cases, for each axis."""
    return {
        axis: tuple(
            float(np.mean([case["stops"][-1]["estimates"][axis][key] for case in cases.values()]))
            for key in ("a", "b")
        )
        for axis in ("x", "y", "z", "sum")
    }  # type: ignore[return-value]


def deviation(a: float, b: float, sweeps: float, nodes: float) -> float:
    """Formula 3.4.7: the integral of exp(-a i + b) from the last sweep on, over the nodes."""
    return float(np.exp(-a * sweeps + b) / (a * nodes))


def implied_nodes(sweeps: int, _: float, estimated: float, a: float, b: float) -> int:
    """The number of nodes with which a row of Table 3.5.1 agrees with formula 3.4.7."""
    return round(deviation(a, b, sweeps, 1.0) / estimated)


def sweeps_to(curve: dict[str, Any], limit: float) -> int | None:
    """First kept sweep after which the sum along each axis is below a limit."""
    met = (np.array(curve["sums"])[:, :3] < limit).all(axis=1)
    return curve["step"] * (int(met.argmax()) + 1) if met.any() else None


def time_rows(
    cases: dict[str, Any], middle: dict[str, Any], sweep_seconds: float
) -> list[dict[str, Any]]:
    """Table 3.4.4 beside the same formula with our fit of the sum, and the true distance."""
    a, b = average_fit(cases)["sum"]
    nodes = float(np.mean([case["counted_nodes"] for case in cases.values()]))
    measured = {row["sweeps"]: row for row in [*middle["stops"], *middle["further_stops"]]}
    rows = []
    for sweeps, hours, printed in PUBLISHED_TIMES:
        row = measured.get(sweeps)
        rows.append(
            {
                "sweeps": sweeps,
                "hours": hours,
                "printed": printed,
                "formula": deviation(*PUBLISHED_AVERAGE, sweeps, PUBLISHED_NODES),
                "ours": deviation(a, b, sweeps, nodes),
                "true_sum": sum(row["axes"].values()) if row else None,
                "true": row["mean"] if row else None,
                "seconds": sweeps * sweep_seconds,
            }
        )
    return rows


def ball_figures(cases: dict[str, Any]) -> dict[str, Any]:
    """Least and most that an abnormality moved and was compressed at the highest compression."""
    balls = cases["80-35"]["moved"]["abnormalities"]
    return {
        "distance": [f([ball["distance"] for ball in balls]) for f in (min, max)],
        "height": [f([ball["extent_ratio"][2] for ball in balls]) for f in (min, max)],
        "breast_height": cases["80-35"]["gap"] / 119.0,
    }


def draw_convergence(found: dict[str, Any]) -> Any:
    """Figures 3.4.1 to 3.4.5: summed displacement of each sweep along each axis."""
    cases = found["compression"]
    figure, panels = plt.subplots(1, 5, figsize=(11, 2.9), sharey=True, layout="constrained")
    for panel, (name, case) in zip(panels, cases.items(), strict=True):
        sums = np.array(case["curve"]["sums"])
        sweeps = case["curve"]["step"] * np.arange(1, len(sums) + 1)
        for column, (axis, colour) in enumerate(COLOURS.items()):
            panel.semilogy(sweeps, sums[:, column], color=colour, label=axis)
        a, b = PUBLISHED_FITS[name]
        published = np.array([1, 3500])
        panel.semilogy(published, np.exp(-a * published + b), "k:", label="thesis' fit")
        panel.axhline(1e-4 * case["counted_nodes"], color="0.6", lw=0.8)
        panel.set(title=name, xlabel="sweep")
    panels[0].set_ylabel("sum of |displacement|, units")
    panels[-1].legend(frameon=False)
    return figure


def draw_section(found: dict[str, Any]) -> Any:
    """Figures 3.3.6 and 3.3.8: a section at rest and at the highest compression."""
    table = np.array(found["compression"]["80-35"]["section"])
    table[:, :4] -= 1.0  # the lattice has a layer of air around
    figure, panels = plt.subplots(1, 2, figsize=(6, 4.6), sharey=True, layout="constrained")
    shades = {4.5: ("#e8c98f", "fat"), 15.0: ("#b5654a", "gland"), 45.0: ("#1b3a5c", "abnormality")}
    for panel, columns, title in zip(panels, ((0, 1), (2, 3)), ("at rest", "80-35"), strict=True):
        for modulus, (colour, name) in shades.items():
            rows = table[table[:, 4] == modulus]
            panel.plot(*rows[:, columns].T, ".", ms=1.8, color=colour, label=name)
        panel.set(title=title, xlabel="x from the chest wall, units", aspect="equal")
    panels[0].set_ylabel("z, units")
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
        frameon=False, markerscale=4,
    )  # fmt: skip
    return figure


def draw_reverse(found: dict[str, Any]) -> Any:
    """Figure 3.5.3: real and estimated deviation of the decompression."""
    rows = found["reverse"]["stops"]
    sweeps = [row["sweeps"] for row in rows]
    figure, panel = plt.subplots(figsize=(6, 3.6), layout="constrained")
    panel.semilogy(sweeps, [row["mean"] for row in rows], "o-", color="#0072b2", label="real")
    estimated = [row["estimates"]["sum"]["deviation"] for row in rows]
    panel.semilogy(sweeps, _gaps(estimated), "o--", color="#56b4e9", label="estimated")
    printed = np.array([row[1:3] for row in PUBLISHED_REVERSE], dtype=float)
    panel.semilogy(sweeps, printed[:, 0], "ks-", ms=4, label="thesis, calculated")
    panel.semilogy(sweeps, printed[:, 1], "ks--", ms=4, mfc="w", label="thesis, estimated")
    panel.set(xlabel="sweep", ylabel="mean distance from rest, units")
    panel.legend(frameon=False)
    return figure


def _gaps(values: list[float | None]) -> list[float]:
    return [np.nan if value is None else value for value in values]


def draw_time(found: dict[str, Any]) -> Any:
    """Figures 3.4.6 and 3.4.7: time against deviation, both solvers."""
    case = found["compression"][found["starts"]["case"]]
    rows = [*case["stops"], *case["further_stops"]]
    seconds = [found["times"]["sweep_seconds"] * row["sweeps"] for row in rows]
    published = np.array(PUBLISHED_TIMES)
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    panels[0].plot([row["mean"] for row in rows], [row["sweeps"] for row in rows], "o-",
                   color="#0072b2", label="relaxation, real")  # fmt: skip
    panels[0].plot(published[:, 2], published[:, 0], "ks--", ms=4, label="thesis, estimated")
    panels[0].set(xlabel="mean deviation, units", ylabel="sweeps")
    panels[1].loglog([row["mean"] for row in rows], seconds, "o-",
                     color="#0072b2", label="relaxation")  # fmt: skip
    fast = found["times"]["multigrid"]
    panels[1].loglog([row["mean"] for row in fast], [row["seconds"] for row in fast], "^-",
                     color="#d55e00", label="multigrid")  # fmt: skip
    panels[1].loglog(
        published[:, 2], 3600 * published[:, 1], "ks--", ms=4, label="thesis (Celeron)"
    )
    panels[1].set(xlabel="mean deviation, units", ylabel="seconds")
    for panel in panels:
        panel.legend(frameon=False)
    return figure


def draw_starts(found: dict[str, Any]) -> Any:
    """Convergence along x and z from each starting state."""
    starts = found["starts"]
    curves = {"springs in series": found["compression"][starts["case"]]["curve"]}
    curves |= {name: guess["curve"] for name, guess in starts["guesses"].items()}
    figure, panels = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True, layout="constrained")
    for panel, axis, column in zip(panels, "xz", (0, 2), strict=True):
        for (name, curve), colour in zip(curves.items(), COLOURS.values(), strict=True):
            sums = np.array(curve["sums"])
            sweeps = curve["step"] * np.arange(1, len(sums) + 1)
            panel.semilogy(sweeps, sums[:, column] / sums[:, 3], color=colour, label=name)
        panel.axhline(1e-4, color="0.6", lw=0.8)
        panel.set(title=axis, xlabel="sweep")
    panels[0].set_ylabel("mean |displacement|, units")
    panels[1].legend(frameon=False)
    return figure

"""Progress of a run's stages."""

from __future__ import annotations

from contextlib import contextmanager
from math import isfinite
from time import monotonic
from typing import TYPE_CHECKING, Any

from mammosim.cli.terminal import err

if TYPE_CHECKING:
    from collections.abc import Iterator

SECONDS_A_LINE = 30.0
"""Between two lines of a stage's progress where there is no terminal."""


@contextmanager
def progress() -> Iterator[Any]:
    """Show stages: a moving line on a terminal, plain lines now and then elsewhere."""
    began = monotonic()
    if not err.is_terminal:
        last_line = monotonic()

        def log(view: str, stage: str, row: Any) -> None:
            nonlocal began, last_line
            where = f"{view + ': ' if view else ''}{stage}"
            if row is None:
                began = last_line = monotonic()
                err.print(where, highlight=False)
            elif monotonic() - last_line > SECONDS_A_LINE:
                last_line = monotonic()
                err.print(f"{where}: {row_text(row, last_line - began)}", highlight=False)

        yield log
        return
    with err.status("starting") as status:

        def show(view: str, stage: str, row: Any) -> None:
            nonlocal began
            where = f"[bold]{view}[/] " if view else ""
            if row is None:
                began = monotonic()
                status.update(f"{where}{stage}")
            else:
                status.update(f"{where}{stage}: {row_text(row, monotonic() - began)}")

        yield show


def row_text(row: Any, seconds: float) -> str:
    """A row of a solver's history in a few words, `seconds` after the stage began."""
    if "sweep" in row.dtype.names:
        nodes = max(int(row["nodes_counted"]), 1)
        means = ", ".join(f"{axis} {row[f'sum_d{axis}_voxel'] / nodes:.1e}" for axis in "xyz")
        left = row["sweeps_left"] * seconds / row["sweep"]
        end = f", about {left / 60:.1f} min left" if isfinite(left) else ""
        return (
            f"sweep {row['sweep']}{end}, mean move {means} voxel, volume "
            f"{-row['volume_change_percent']:+.1f} %, {row['inverted_cells']} cells inverted"
        )
    if "element_mm" in row.dtype.names:
        return (
            f"{row['element_mm']:g} mm elements, gap {row['gap_mm']:.1f} mm: out of balance "
            f"{row['out_of_balance']:.1e}, {row['force_n']:.1f} N, smallest J "
            f"{row['smallest_j']:.2f}"
        )
    return (
        f"{row['nodes']} nodes, {row['axis']}: error {row['error_estimate_voxel']:.1e} voxel, "
        f"{row['nodes_held']} held by the plates"
    )

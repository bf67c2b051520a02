"""From pictures back to the breast: locate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from mammosim.cli.terminal import app, exit_status, say
from mammosim.errors import InputError


class _PixelPairs(TyperCommand):
    """A command whose `--pixel` takes two numbers each time, which Typer's lists cannot say."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        joined, rest = [], list(args)
        while rest:
            joined.append(rest.pop(0))
            if joined[-1] == "--pixel" and len(rest) > 1:
                joined.append(f"{rest.pop(0)} {rest.pop(0)}")
        return super().parse_args(ctx, joined)


@app.command(cls=_PixelPairs)
def locate(
    run: Annotated[Path, typer.Argument(help="A finished run's folder.")],
    view: Annotated[list[str], typer.Option(help="View of the next --pixel, e.g. CC.")],
    pixel: Annotated[list[str], typer.Option(metavar="ROW COL", help="Where it is seen; from 0.")],
    height_mm: Annotated[
        float | None, typer.Option(help="Height above the breast support, mm, if known.")
    ] = None,
    tube_angle: Annotated[
        list[float] | None,
        typer.Option(help="Tube angle of each image, degrees; -15 and 15 for a stereotactic pair."),
    ] = None,
    step_mm: Annotated[
        float,
        typer.Option(min=0.1, max=50.0, help="Step along the curve that one pixel gives, mm."),
    ] = 5.0,
) -> None:
    """Locate pixels of one or two mammograms in the uncompressed breast.

    One pixel gives the curve of points that it may show, or with --height-mm one point. Two
    pixels of different views, or of one view at two tube angles, give the point where they meet.
    """
    with exit_status(result_is_text=True):
        from mammosim.cli.located_lines import located_lines
        from mammosim.pipeline import locate_in_run

        pixels = [_pixel(text) for text in pixel]
        for line in located_lines(locate_in_run(run, view, pixels, tube_angle, height_mm, step_mm)):
            say(line)


def _pixel(text: str) -> tuple[float, float]:
    try:
        row, column = (float(word) for word in text.split())
    except ValueError:
        raise InputError(
            f"--pixel: found '{text}', expected row and column, e.g. 812.5 340"
        ) from None
    return row, column

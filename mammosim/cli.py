"""The command line: reads arguments, calls the pipeline, and is the only place that prints.

Exit status: 0 done, 2 bad input, 3 not converged, 130 interrupted.
"""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from importlib.resources import as_file, files
from math import isfinite
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from typer.core import TyperCommand

from mammosim.errors import InputError, Interrupted, MammosimError, NotConverged

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mammosim.phantom import PhantomSummary
    from mammosim.pipeline import Study

BAD_INPUT, UNCONVERGED, INTERRUPTED = 2, 3, 130

SECONDS_A_LINE = 30.0
"""Between two lines of a stage's progress where there is no terminal."""

app = typer.Typer(
    help="Synthetic mammograms from labelled voxel breasts, and where each lesion went.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out, err = Console(soft_wrap=True), Console(stderr=True, soft_wrap=True)
_debug = False


def main() -> None:
    """Entry point of the command `mammosim`."""
    app()


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option(help="Show tracebacks of errors.")] = False,
    version: Annotated[bool, typer.Option(help="Print the version and stop.")] = False,
) -> None:
    global _debug
    _debug = debug
    if version:
        from mammosim import __version__

        out.print(__version__)
        raise typer.Exit


@contextmanager
def _exit_status() -> Iterator[None]:
    """Turn the package's errors into plain lines and the exit status that belongs to them."""
    try:
        yield
    except MammosimError as error:
        if _debug:
            raise
        for line in getattr(error, "problems", None) or str(error).splitlines():
            err.print(f"[bold red]error:[/] {_plain(line)}", highlight=False)
        kinds = {InputError: BAD_INPUT, NotConverged: UNCONVERGED, Interrupted: INTERRUPTED}
        raise typer.Exit(kinds.get(type(error), 1)) from None
    except KeyboardInterrupt:
        err.print("[bold red]interrupted[/]")
        raise typer.Exit(INTERRUPTED) from None


def _plain(text: str) -> str:
    return text.replace("[", r"\[")


@app.command()
def new(name: Annotated[str, typer.Argument(help="Name of the example, as quickstart.")]) -> None:
    """Write a commented example configuration into the current folder."""
    with _exit_status(), _examples() as folder:
        examples = sorted(path.stem for path in folder.glob("*.yaml"))
        if name not in examples:
            raise InputError(f"new: found '{name}', expected one of {', '.join(examples)}")
        target = Path(f"{name}.yaml")
        try:
            with target.open("x", encoding="utf-8") as stream:
                stream.write((folder / target.name).read_text(encoding="utf-8"))
        except FileExistsError:
            raise InputError(f"{target}: exists already; remove it first") from None
        except OSError as error:
            raise InputError(f"{target}: cannot be written ({error.strerror})") from None
        out.print(f"wrote {target}; run it with: mammosim run {target}")


@contextmanager
def _examples() -> Iterator[Path]:
    """Folder of the example configurations: in the package, or beside it in a checkout."""
    inside = files("mammosim").joinpath("configs")
    if inside.is_dir():
        with as_file(inside) as folder:
            yield folder
    else:
        yield Path(__file__).parents[1] / "configs"


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="The configuration, a YAML file.")],
    output: Annotated[
        Path | None, typer.Option(help="The run's folder; default runs/ and the file's name.")
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Another value for a key."),
    ] = None,
    resume: Annotated[
        bool,
        typer.Option(help="Go on with what is there; do nothing if the same run is finished."),
    ] = False,
    overwrite: Annotated[
        bool, typer.Option(help="Replace what is in the folder; stages that still hold are kept.")
    ] = False,
    reuse: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Folder of another run, to take stages from that fit."),
    ] = None,
) -> None:
    """Run the whole pipeline."""
    with _exit_status():
        from mammosim.pipeline import (
            RunFolder,
            check_output,
            is_finished,
            load_config,
            simulate,
            title_of,
            writing,
        )  # fmt: skip

        title = title_of(config)
        folder = output or Path("runs") / title
        check_output(folder, resume, overwrite)
        settings = load_config(config, change or ())
        with writing(folder):
            if resume and is_finished(folder, settings):
                out.print(f"{folder}: this run is finished already")
                return
            saved = RunFolder(folder, settings, title, reuse or ())
            with _progress() as tell:
                study = simulate(settings, saved, tell)
        _print_summary(study, folder)
        if saved.stages.reused:
            kept = ", ".join(saved.stages.reused)
            out.print(f"kept from before: {kept}", highlight=False)


@contextmanager
def _progress() -> Iterator[Any]:
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
                err.print(f"{where}: {_row_text(row, last_line - began)}", highlight=False)

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
                status.update(f"{where}{stage}: {_row_text(row, monotonic() - began)}")

        yield show


def _row_text(row: Any, seconds: float) -> str:
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


def _print_summary(study: Study, folder: Path) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in ("view", "target", "shift mm", "row px", "column px", "in field"):
        table.add_column(heading, justify="left" if heading in ("view", "target") else "right")
    for row in study.targets:
        table.add_row(
            row.view, row.name, f"{row.shift_mm:.1f}", f"{row.image_row_px:.0f}",
            f"{row.image_col_px:.0f}", "yes" if row.in_field else "no",
        )  # fmt: skip
    out.print(table)
    for name, view in study.views.items():
        if view.mammogram is not None:
            taken = view.series or view.mammogram  # load and dose of all projections together
            count = f"{len(view.series.gantries)} projections, " if view.series else ""
            out.print(
                f"{name}: {count}{view.squeezed.thickness_mm:.1f} mm, "
                f"{view.squeezed.force_n:.1f} N, "
                f"{view.mammogram.kvp:g} kV {view.mammogram.target}/{view.mammogram.filter}, "
                f"{taken.mas:.0f} mAs, {taken.dose_mgy:.2f} mGy",
                highlight=False,
            )
    out.print(f"results in {folder}; open {folder / 'report.html'}", highlight=False)


@app.command()
def check(
    config: Annotated[Path, typer.Argument(help="The configuration, a YAML file.")],
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Another value for a key."),
    ] = None,
) -> None:
    """Validate a configuration and print the plan, without computing anything."""
    with _exit_status():
        from mammosim.pipeline import check_before, load_config, make_plan

        settings = load_config(config, change or ())
        plan = make_plan(settings)
        check_before(settings)
        for line in plan.lines:
            out.print(_plain(line), highlight=False)
        out.print(
            f"about {plan.memory_gb:.1f} GB of memory and {max(plan.minutes, 0.1):.1f} minutes "
            "on two cores",
            highlight=False,
        )


Labels = Annotated[
    str | None, typer.Option(help="Label map: a name, or a YAML file of label: tissue.")
]
Axes = Annotated[
    str | None,
    typer.Option(help="Towards what the file's axes run, as ALS (key phantom.axes)."),
]
VoxelMm = Annotated[
    str | None,
    typer.Option(help="Voxel size, mm: one number, or three as 0.2,0.2,0.5 (phantom.voxel_mm)."),
]
Reduce = Annotated[
    int, typer.Option(help="Of every n voxels along each axis keep one (phantom.reduce).")
]


@app.command()
def info(
    phantom: Annotated[Path, typer.Argument(help="A phantom file, or a folder of DICOM slices.")],
    labels: Labels = None,
    axes: Axes = None,
    voxel_mm: VoxelMm = None,
    reduce: Reduce = 1,
) -> None:
    """Size, voxel, extent, volume per tissue, orientation, side and lesions of a phantom."""
    with _exit_status():
        from mammosim.phantom import phantom_summary, read_phantom

        breast = read_phantom(phantom, labels, None, axes, _sizes(voxel_mm), reduce)
        _print_phantom(phantom_summary(breast))


def _sizes(text: str | None) -> list[float] | float | None:
    """One number, or three between commas."""
    if text is None:
        return None
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3):
        raise InputError(f"--voxel-mm: found '{text}', expected one number or three, as 0.2,0.2,1")
    return numbers[0] if len(numbers) == 1 else numbers


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="What `info` reads.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="Its ending says the format, as .nrrd or .mhd.")
    ],
    labels: Labels = None,
    axes: Axes = None,
    voxel_mm: VoxelMm = None,
    reduce: Reduce = 1,
) -> None:
    """Write a phantom in another format, voxel by voxel at the same place.

    With --labels its values become mammosim's own labels, else they stay as they are.
    """
    with _exit_status():
        from mammosim.export import convert_volume

        done = convert_volume(source, target, labels, axes, _sizes(voxel_mm), reduce)
        sizes = " x ".join(str(side) for side in done.frame.shape)
        spacing = " x ".join(f"{step:g}" for step in done.frame.spacing_mm)
        found = ", ".join(str(label) for label in sorted(done.counts))
        out.print(f"wrote {_plain(str(target))}: {sizes} voxels of {spacing} mm", highlight=False)
        out.print(f"labels: {found}", highlight=False)
        out.print(f"orientation: {_plain(done.orientation)}", highlight=False)
        for note in done.notes:
            out.print(f"note: {_plain(note)}", highlight=False)


def _print_phantom(summary: PhantomSummary) -> None:
    def spans(values: Any, pattern: str) -> str:
        return " x ".join(pattern.format(value) for value in values)

    extent = ", ".join(
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, (low, high) in zip("xyz", summary.extent_mm, strict=True)
    )
    side = {"L": "left", "R": "right"}[summary.laterality]
    lines = [
        ("source", summary.source),
        ("size", f"{spans(summary.shape, '{}')} voxels of {spans(summary.voxel_mm, '{:g}')} mm"),
        ("orientation", summary.orientation),
        ("tissue", f"{extent} mm (x anterior, y patient's left, z superior)"),
        ("side", f"{side} ({summary.laterality})"),
        ("nipple", f"{', '.join(f'{value:.1f}' for value in summary.nipple_mm)} mm"),
        ("breast", f"{summary.breast_ml:.1f} mL without muscle"),
    ]
    if summary.fibroglandular_percent is not None:
        share = f"{summary.fibroglandular_percent:.1f} % of the volume within the skin"
        lines.append(("fibroglandular", share))
    lines += [(f"  {tissue}", f"{ml:.2f} mL") for tissue, ml in summary.volume_ml.items()]
    for lesion in summary.lesions:
        place = ", ".join(f"{value:.1f}" for value in lesion.position_mm)
        lines.append(
            ("lesion", f"{lesion.name} ({lesion.kind}), {lesion.volume_mm3:.1f} mm3 at {place} mm")
        )
    lines += [("note", note) for note in summary.notes]
    for heading, value in lines:
        out.print(f"{heading}: {_plain(value)}", highlight=False)


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
    view: Annotated[list[str], typer.Option(help="View that the next --pixel is in, as CC.")],
    pixel: Annotated[list[str], typer.Option(metavar="ROW COL", help="Where it is seen; from 0.")],
    height_mm: Annotated[
        float | None, typer.Option(help="Height above the breast support, mm, where it is known.")
    ] = None,
    tube_angle: Annotated[
        list[float] | None,
        typer.Option(help="Tube's angle of each picture, degrees: a stereotactic pair is -15, 15."),
    ] = None,
    step_mm: Annotated[
        float, typer.Option(min=0.1, max=50.0, help="Of the curve that one pixel gives, mm.")
    ] = 5.0,
) -> None:
    """From one or two mammograms back to the uncompressed breast.

    One pixel gives the curve of points that it may show, with --height-mm a point; two of
    different views, or of one view under two tube angles, the point where they meet.
    """
    with _exit_status():
        from mammosim.pipeline.locating import locate_lines

        pixels = [_pixel(text) for text in pixel]
        for line in locate_lines(run, view, pixels, tube_angle, height_mm, step_mm):
            out.print(_plain(line), highlight=False)


def _pixel(text: str) -> tuple[float, float]:
    try:
        row, column = (float(word) for word in text.split())
    except ValueError:
        raise InputError(
            f"--pixel: found '{text}', expected row and column, as 812.5 340"
        ) from None
    return row, column


@app.command()
def schema() -> None:
    """Print the JSON Schema of the configuration."""
    from mammosim.pipeline import RunConfig

    sys.stdout.write(json.dumps(RunConfig.model_json_schema(), indent=2) + "\n")

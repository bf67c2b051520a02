"""Commands about one run: new, run, check, schema."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from mammosim._loading import loading
from mammosim._wording import counted
from mammosim.cli.progress import event_lines, progress
from mammosim.cli.rehearsing import rehearsing
from mammosim.cli.signals import signals_interrupt
from mammosim.cli.terminal import (
    app,
    check_output,
    exit_status,
    out,
    print_warnings,
    printable,
    say,
)
from mammosim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from mammosim.pipeline import Study


@contextmanager
def _examples() -> Iterator[Path]:
    """Folder of the example configurations: in the package, or beside it in a checkout."""
    inside = files("mammosim").joinpath("configs")
    if inside.is_dir():
        with as_file(inside) as folder:
            yield folder
    else:
        yield Path(__file__).parents[2] / "configs"


def _example_names() -> list[str]:
    """Names of the examples, the first one to try first."""
    with _examples() as folder:
        names = (path.stem for path in folder.glob("*.yaml"))
        return sorted(names, key=lambda name: (name != "quickstart", name))


def _described_examples() -> str:
    """Each example's name and its first comment line, for the help."""
    with _examples() as folder:
        lines = []
        for name in _example_names():
            with (folder / f"{name}.yaml").open(encoding="utf-8") as stream:
                lines.append(f"{name}: {stream.readline().lstrip('# ').strip()}")
    return "Examples:\n\n" + "\n\n".join(lines)


@app.command(epilog=_described_examples())
def new(
    name: Annotated[
        str,
        typer.Argument(
            help=f"Name of the example: {', '.join(_example_names())}.",
            autocompletion=_example_names,
        ),
    ],
) -> None:
    """Write a commented example configuration into the current folder."""
    with exit_status(), _examples() as folder:
        examples = _example_names()
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
        command = "cohort run" if name == "cohort" else "run"
        say(f"wrote {target}; run it with: mammosim {command} {target}")


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
        typer.Option(help="Continue with what is there; do nothing if the same run is finished."),
    ] = False,
    overwrite: Annotated[
        bool,
        typer.Option(help="Replace what is in the folder; stages that are still valid are kept."),
    ] = False,
    reuse: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN", help="Folder of another run whose matching stages are reused."),
    ] = None,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show the solver's progress.")
    ] = False,
    events: Annotated[
        bool, typer.Option("--events", hidden=True, help="Progress as JSON, one line per event.")
    ] = False,
) -> None:
    """Run the whole pipeline."""
    with exit_status():
        with loading():
            from mammosim.pipeline import (
                RunFolder,
                check_memory_limit,
                is_finished,
                keep_freed_memory,
                load_config,
                make_plan,
                refuse_own_configuration,
                simulate,
                title_of,
                writing,
            )  # fmt: skip

        title = title_of(config)
        folder = output or Path("runs") / title
        check_output(folder, resume, overwrite)
        settings = load_config(config, change or ())
        if resume and is_finished(folder, settings):  # also where nothing can be written
            say(f"{folder}: this run is already finished")
            return
        plan = make_plan(settings)
        check_memory_limit(plan)
        print_warnings(plan.warnings)
        refuse_own_configuration(folder, config)
        keep_freed_memory()
        with signals_interrupt() as interrupt_if_one_came, writing(folder):
            saved = RunFolder(folder, settings, title, reuse or ())
            shown = event_lines(plan) if events else progress(plan, verbose)
            with shown as show, rehearsing(settings, plan):

                def on_progress(view: str, stage: str, row: Any) -> None:
                    interrupt_if_one_came()
                    show(view, stage, row)

                study = simulate(settings, saved, on_progress)
        _print_summary(study, folder)
        print_warnings(note for note in study.notes if note not in plan.warnings)
        _warn_of_kernel_cache()
        if saved.stages.reused:
            kept = ", ".join(saved.stages.reused)
            say(f"kept from before: {kept}")


def _warn_of_kernel_cache() -> None:
    """Say why the next run has to compile its kernels again, if it has to."""
    from mammosim._kernel_cache import cache_problem

    problem = cache_problem()
    if problem:
        print_warnings([
            f"compiled kernels {problem}; the next run compiles them again. Set NUMBA_CACHE_DIR "
            "to a folder that can be written"
        ])  # fmt: skip


def _print_summary(study: Study, folder: Path) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in ("view", "target", "shift mm", "row px", "column px", "in field"):
        table.add_column(heading, justify="left" if heading in ("view", "target") else "right")
    for row in study.targets:
        table.add_row(
            f"{row.laterality}{row.view}", Text(printable(row.name)), f"{row.shift_mm:.1f}",
            f"{row.image_row_px:.0f}", f"{row.image_col_px:.0f}", "yes" if row.in_field else "no",
        )  # fmt: skip
    out.print(table)
    for name, view in study.views.items():
        if view.mammogram is not None:
            taken = view.series or view.mammogram  # load and dose of all projections together
            count = f"{counted(len(view.series.gantries), 'projection')}, " if view.series else ""
            say(
                f"{name}: {count}{view.compressed.thickness_mm:.1f} mm, "
                f"{view.compressed.force_n:.1f} N, "
                f"{view.mammogram.kvp:g} kV {view.mammogram.target}/{view.mammogram.filter}, "
                f"{taken.mas:.0f} mAs, {taken.dose_mgy:.2f} mGy"
            )
    page = folder / "report.html"
    say(f"results in {folder}" + (f"; open {page}" if page.exists() else ""))


@app.command()
def check(
    config: Annotated[Path, typer.Argument(help="A run's configuration, or a cohort's file.")],
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Another value for a key."),
    ] = None,
) -> None:
    """Check a configuration and print the plan, without simulating anything."""
    with exit_status(result_is_text=True):
        from mammosim.config import read_yaml
        from mammosim.pipeline import is_cohort

        plan_of = _cohort_plan if is_cohort(read_yaml(config)) else _run_plan
        lines, warnings = plan_of(config, change or ())
        for line in lines:
            say(line)
        print_warnings(warnings)


def _run_plan(config: Path, changes: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    from mammosim.pipeline import check_before, check_memory_limit, load_config, make_plan

    settings = load_config(config, changes)
    plan = make_plan(settings)
    check_memory_limit(plan)
    warnings = (*plan.warnings, *check_before(settings))
    needs = f"about {plan.memory_gb:.1f} GB of memory and {max(plan.minutes, 0.1):.1f} minutes"
    return [*plan.lines, f"{needs} on two cores"], warnings


def _cohort_plan(config: Path, changes: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    from mammosim.cohort import load_cohort, plan_cohort

    plan = plan_cohort(load_cohort(config, changes))
    time = f"{plan.hours:.0f} hours" if plan.hours > 3 else f"{60 * plan.hours:.0f} minutes"
    lines = [
        *plan.lines,
        f"about {plan.memory_gb:.1f} GB of memory per worker and {time} in total; workers on this "
        f"machine: {plan.workers.count}, threads per worker: {plan.workers.threads}",
    ]
    return lines, plan.warnings


@app.command()
def serve(
    port: Annotated[int, typer.Option(min=1024, max=65535, help="Port of the page.")] = 8765,
    runs: Annotated[Path, typer.Option(help="Folder of earlier and new runs.")] = Path("runs"),
) -> None:
    """Open a local page to set up, watch and view runs (needs the extra serve)."""
    with exit_status(), _examples() as folder:
        from mammosim.serve import serve as serve_page

        serve_page(port, folder, runs, _run_words, lambda address: say(f"open {address}"))


def _run_words(config: Path, folder: Path) -> list[str]:
    """Arguments of the run that the page starts."""
    return ["run", str(config), "--output", str(folder), "--events"]


@app.command()
def schema(
    cohort: Annotated[bool, typer.Option("--cohort", help="That of a cohort's file.")] = False,
) -> None:
    """Print the JSON Schema of the configuration."""
    if cohort:
        from mammosim.cohort import cohort_schema

        printed = cohort_schema()
    else:
        from mammosim.pipeline import RunConfig

        printed = RunConfig.model_json_schema()
    sys.stdout.write(json.dumps(printed, indent=2) + "\n")

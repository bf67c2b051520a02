"""The page itself: the form on the left, runs and their results on the right."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from fastapi import Response
from fastapi.responses import FileResponse
from nicegui import app, events, ui

from mammosim.config import parse_value, read_yaml, write_yaml
from mammosim.errors import InputError
from mammosim.report import key_in_words
from mammosim.serve import results
from mammosim.serve.form import (
    Field,
    as_text,
    by_field,
    checked,
    form_fields,
    texts_of,
    values_of,
)
from mammosim.serve.jobs import Command, Job, Jobs

REFRESH_S = 0.7
"""Interval at which the page checks the runs."""

FIRST = ("phantom", "compression", "views", "acquisition")
"""Sections of the form that are open at first."""

LESION_COLUMNS = ("name", "kind", "laterality", "view", "shift_mm", "x_mm", "y_mm", "z_mm",
                  "nipple_distance_mm", "skin_depth_mm", "in_field")  # fmt: skip


def add_page(examples: Path, runs: Path, command: Command) -> Jobs:
    """Add the page and what it fetches to the application.

    Parameters
    ----------
    examples : Path
        Folder of example configurations.
    runs : Path
        Folder of runs.
    command : callable
        See `Jobs`.

    Returns
    -------
    Jobs
        The runs started from the page; they outlast a reload.
    """
    jobs, fields = Jobs(command), form_fields()

    @app.get("/picture/{run}/{view}")
    def picture(run: str, view: str, level: float = 0.5, width: float = 1.0) -> Response:
        folder = _run_folder(runs, run)
        if folder is None or view not in results.views_of(folder):
            return Response(status_code=404)
        return Response(results.picture_jpeg(folder, view, level, width), media_type="image/jpeg")

    @app.get("/file/{run}/{path:path}", response_model=None)
    def file(run: str, path: str) -> Response:
        folder = _run_folder(runs, run)
        if folder is None or path not in results.files_of(folder):
            return Response(status_code=404)
        return FileResponse(folder / path)

    @ui.page("/")
    def index() -> None:
        _Page(jobs, fields, examples, runs)

    return jobs


def _run_folder(runs: Path, name: str) -> Path | None:
    """The run's folder of that name; None unless it lies directly in the folder of runs."""
    folder = runs / name
    return folder if folder.parent == runs and folder.is_dir() and name not in ("", "..") else None


class _Page:
    """One open window of the page: its form and the run it shows."""

    def __init__(self, jobs: Jobs, fields: tuple[Field, ...], examples: Path, runs: Path) -> None:
        self._jobs, self._fields, self._runs, self._examples = jobs, fields, runs, examples
        self._opened: dict[str, Any] = {}
        self._folder = Path.cwd()
        self._inputs: dict[str, Any] = {}
        self._shown: Path | None = jobs.all[-1].folder if jobs.all else None
        self._state: tuple[Any, ...] = ()
        ui.colors(primary="#1f5f99")  # enough contrast for white letters
        ui.add_head_html('<script>document.documentElement.lang = "en"</script>')
        with ui.splitter(value=42).classes("w-full h-screen") as halves:
            with halves.before, ui.column().classes("w-full p-4 gap-2"):
                self._configuration()
            with halves.after, ui.column().classes("w-full p-4 gap-2"):
                self._list_of_runs()
                self._detail()
        self._open_example("quickstart")
        ui.timer(REFRESH_S, self._look)

    # The form.

    def _configuration(self) -> None:
        ui.label("Configuration").classes("text-h6")
        names = sorted(path.stem for path in self._examples.glob("*.yaml") if path.stem != "cohort")
        with ui.row().classes("items-center w-full"):
            self._example = ui.select(
                names, label="Example", value="quickstart",
                on_change=lambda change: self._open_example(str(change.value)),
            ).classes("w-40")  # fmt: skip
            ui.upload(label="Open a file", auto_upload=True, on_upload=self._open_upload).props(
                "accept=.yaml,.yml flat"
            ).classes("w-56")
        self._name = ui.input("Name of the run", value="run").props("dense")
        self._problems = ui.column().classes("text-negative")
        with ui.row():
            ui.button("Check", on_click=self._check)
            ui.button("Run", on_click=self._start)
        for section in dict.fromkeys(field.path[0] for field in self._fields):
            opened = section in FIRST
            with ui.expansion(section, value=opened).classes("w-full") as part:
                part.props("dense header-class=text-weight-medium")
                for field in self._fields:
                    if field.path[0] == section:
                        self._inputs[field.key] = self._input(field)

    def _input(self, field: Field) -> Any:
        """An input for a field, with its key, description and default."""
        label, hint = f"{field.label}  ({field.key})", field.text
        default = f"default: {field.default}" if field.default else "not set"
        if field.kind in ("choice", "switch"):
            choices = field.choices or ("true", "false")
            entry: Any = ui.select({"": default, **{one: one for one in choices}}, label=label,
                                   value="")  # fmt: skip
        else:
            entry = ui.input(label, placeholder=default)
        entry.props("dense hide-bottom-space").classes("w-full")
        entry.mark(field.key)
        with entry:
            ui.tooltip(hint).classes("max-w-md")
        ui.label(hint).classes("text-caption text-grey-7 -mt-1 mb-1")
        return entry

    def _open_example(self, name: str) -> None:
        self._take(read_yaml(self._examples / f"{name}.yaml"), name, self._examples)

    async def _open_upload(self, upload: events.UploadEventArguments) -> None:
        text = (await upload.file.read()).decode("utf-8", errors="replace")
        name = Path(upload.file.name).stem
        try:
            values = parse_value(text, upload.file.name)
        except InputError as error:
            self._show_problems({}, list(error.problems))
            return
        self._take(values, name, Path.cwd())

    def _take(self, values: Any, name: str, folder: Path) -> None:
        """Fill the form with a configuration."""
        if not isinstance(values, dict):
            self._show_problems({}, [f"{name}: expected a mapping of sections"])
            return
        self._opened, self._folder = values, folder
        texts = texts_of(values, self._fields)
        for field in self._fields:
            self._inputs[field.key].value = texts.get(field.key, "")
        self._name.value = name
        self._show_problems({}, [])

    def _values(self) -> dict[str, Any] | None:
        """The configuration's values; None where they are not valid, and the mistakes are shown."""
        texts = {key: as_text(entry.value or "") for key, entry in self._inputs.items()}
        try:
            values = values_of(texts, self._fields, self._opened)
            checked(values, self._folder)
        except InputError as error:
            self._show_problems(*by_field(error, self._fields))
            return None
        self._show_problems({}, [])
        return values

    def _show_problems(self, placed: dict[str, str], others: list[str]) -> None:
        for key, entry in self._inputs.items():
            wrong = placed.get(key)
            entry.props(remove="error error-message")
            if wrong:
                entry.props["error"] = True
                entry.props["error-message"] = wrong
                entry.update()
        self._problems.clear()
        with self._problems:
            for text in (*(f"{key}: {said}" for key, said in placed.items()), *others):
                ui.label(text)

    def _check(self) -> None:
        if self._values() is not None:
            ui.notify("The configuration is valid.", type="positive")

    def _start(self) -> None:
        values = self._values()
        if values is None:
            return
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in str(self._name.value))
        folder = self._runs / f"{name.strip('.') or 'run'}-{datetime.now():%Y%m%d-%H%M%S-%f}"
        config = folder.with_suffix(".yaml")
        self._runs.mkdir(parents=True, exist_ok=True)
        write_yaml(values, config)
        self._jobs.add(Job(folder, config))
        self._shown = folder
        self._look()

    # Runs and results.

    def _list_of_runs(self) -> None:
        ui.label("Runs").classes("text-h6")
        self._list = ui.row().classes("w-full")

    def _detail(self) -> None:
        with ui.column().classes("w-full") as self._live:
            self._said = ui.label().classes("text-subtitle1").mark("said")
            self._bar = ui.linear_progress(0.0, show_value=False)
            self._cancel_button = ui.button("Cancel, keep what was reached", on_click=self._cancel)
            self._errors = ui.column().classes("text-negative")
            self._curve = ui.echart(
                {
                    "xAxis": {"type": "value", "name": "row"},
                    "yAxis": {"type": "log", "name": "residual"},
                    "legend": {},
                    "animation": False,
                    "series": [],
                }
            ).classes("w-full h-64")
            self._numbers = ui.label().classes("text-caption")
        self._results = ui.column().classes("w-full")

    def _cancel(self) -> None:
        job = self._jobs.of(self._shown) if self._shown else None
        if job is not None:
            job.cancel()

    def _look(self) -> None:
        """Show what has changed since the last look."""
        self._jobs.advance()
        finished = results.runs_in(self._runs) if self._runs.is_dir() else []
        going = [job.folder for job in self._jobs.all if job.folder not in finished]
        every = tuple(dict.fromkeys([*reversed(going), *finished]))
        statuses = tuple(self._status(folder) for folder in every)
        state = (every, statuses, self._shown)
        if state != self._state:
            self._state = state
            self._draw_list(every, statuses)
            self._draw_results()
        self._draw_live()

    def _status(self, folder: Path) -> str:
        job = self._jobs.of(folder)
        return job.status if job is not None else results.status_of(folder)

    def _draw_list(self, every: tuple[Path, ...], statuses: tuple[str, ...]) -> None:
        self._list.clear()
        with self._list:
            for folder, status in zip(every, statuses, strict=True):
                button = ui.button(
                    f"{folder.name}: {status}", on_click=lambda _, to=folder: self._select(to)
                )
                button.props("no-caps dense " + ("" if folder == self._shown else "outline"))
            if not every:
                ui.label("None yet.")

    def _select(self, folder: Path) -> None:
        self._shown = folder
        self._look()

    def _draw_live(self) -> None:
        job = self._jobs.of(self._shown) if self._shown else None
        self._live.visible = job is not None
        if job is None:
            return
        self._said.text = job.text
        self._bar.value = round(job.share, 3)
        self._cancel_button.visible = not job.is_over
        if len(job.said) != len(list(self._errors)):
            self._errors.clear()
            with self._errors:
                for line in job.said:
                    ui.label(line)
        self._draw_curve(job)

    def _draw_curve(self, job: Job) -> None:
        series: list[dict[str, Any]] = []
        last: dict[str, Any] = {}
        for view, rows in job.rows.items():
            for key in _residuals(rows):
                points = [[n, row[key]] for n, row in enumerate(rows, 1) if row.get(key, 0) > 0]
                series.append(
                    {"type": "line", "name": f"{view} {key.replace('_', ' ')}", "data": points,
                     "showSymbol": False}
                )  # fmt: skip
            last = rows[-1] if rows else last
        self._curve.visible = bool(series)
        if self._curve.options["series"] != series:
            self._curve.options["series"] = series
            self._curve.update()
        named = {"volume_change_percent": "volume change, %", "inverted_cells": "folded cells",
                 "smallest_j": "minimum volume ratio", "force_n": "force, N",
                 "gap_mm": "gap, mm"}  # fmt: skip
        shown = [f"{name} {last[key]:.3g}" for key, name in named.items() if key in last]
        self._numbers.text = " · ".join(shown)

    def _draw_results(self) -> None:
        self._results.clear()
        run = self._shown
        if run is None or not (run / "run.json").is_file():
            return
        with self._results:
            for text in results.warnings_of(run):
                ui.label(text).classes("text-caption text-brown-9")
            for view in results.views_of(run):
                self._viewer(run, view)
            facts = results.facts_of(run)
            if facts:
                _table("Views", facts)
            lesions = [
                {key: row.get(key, "") for key in LESION_COLUMNS}
                for row in results.lesion_rows(run)
            ]
            if lesions:
                _table("Where each lesion was, and how far it moved", lesions)
            with ui.expansion("Files").classes("w-full"):
                for path in results.files_of(run):
                    ui.link(path, f"/file/{run.name}/{path}", new_tab=path == "report.html")
            if (run / "report.html").is_file():
                ui.link(
                    "Report, with the slider from uncompressed to compressed",
                    f"/file/{run.name}/report.html", new_tab=True,
                )  # fmt: skip

    def _viewer(self, run: Path, view: str) -> None:
        """A picture with window, zoom and marks."""
        columns, rows = results.shown_size(run, view)
        marks = results.marks_svg(results.marks_of(run, view), columns, rows)
        address = f"/picture/{run.name}/{view}"

        def window() -> None:
            image.set_source(f"{address}?level={level.value}&width={width.value}")

        def resize() -> None:
            image.style(f"width: {zoom.value}%; max-width: none")

        def mark() -> None:
            image.content = marks if marked.value else ""

        with ui.row().classes("items-center w-full"):
            ui.label(view).classes("text-subtitle1")
            level = _slider("Level", "Level", (0.0, 1.0, 0.02), 0.5, window)
            width = _slider("Width", "Width of the window", (0.05, 1.0, 0.05), 1.0, window)
            zoom = _slider("Zoom", "Zoom", (50, 400, 10), 50, resize)
            marked = ui.checkbox("Lesions", value=True, on_change=mark)
        with ui.element("div").classes("w-full overflow-auto bg-black").style("max-height: 70vh"):
            image = ui.interactive_image(f"{address}?level=0.5&width=1", content=marks)
            image.style("width: 50%")


def _slider(
    label: str,
    spoken: str,
    span: tuple[float, float, float],
    value: float,
    on_change: Callable[[], None],
) -> ui.slider:
    """A slider with its label; the span is its minimum, maximum and step."""
    ui.label(label).classes("text-caption")
    low, high, step = span
    slider = ui.slider(min=low, max=high, step=step, value=value, on_change=on_change)
    return slider.classes("w-24").props(f'aria-label="{spoken}"')


def _table(title: str, rows: list[dict[str, Any]]) -> None:
    columns = [
        {"name": key, "label": key_in_words(key), "field": key, "align": "left"} for key in rows[0]
    ]
    ui.table(rows=rows, columns=columns, title=title).props("dense flat").classes("w-full")


def _residuals(rows: list[dict[str, Any]]) -> list[str]:
    """At most two columns that show convergence."""
    telling = ("residual", "error", "move", "deviation", "out_of_balance")
    names = rows[0] if rows else {}
    return [key for key in names if any(word in key for word in telling)][:2]

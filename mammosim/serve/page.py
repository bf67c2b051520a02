"""The page itself: the configuration on the left, runs and their results on the right."""

from __future__ import annotations

import json
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from fastapi import Query, Response
from fastapi.responses import FileResponse, StreamingResponse
from nicegui import app, ui

from mammosim.config import write_yaml
from mammosim.report import pictures_css
from mammosim.serve import results
from mammosim.serve.editor import Editor
from mammosim.serve.form import Field, form_fields
from mammosim.serve.jobs import Command, Job, Jobs
from mammosim.serve.shown import Live, show_comparison, show_run

REFRESH_S = 0.7
"""Interval at which the page checks the runs."""

_NAME_RUNS = (
    "(names) => { const address = new URL(location); address.searchParams.delete('run');"
    " names.forEach((name) => address.searchParams.append('run', name));"
    " history.replaceState(history.state, '', address); }"
)
"""Names the runs that are shown in the page's address, where a reload finds them."""


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

    @app.get("/planes/{run}")
    def planes(run: str) -> Response:
        folder = _run_folder(runs, run)
        page = results.planes_of(folder) if folder is not None else ""
        return Response(page, media_type="text/html", status_code=200 if page else 404)

    @app.get("/file/{run}/{path:path}", response_model=None)
    def file(run: str, path: str) -> Response:
        folder = _run_folder(runs, run)
        if folder is None or path not in results.files_of(folder):
            return Response(status_code=404)
        return FileResponse(folder / path)

    @app.get("/zip/{run}", response_model=None)
    def archive(run: str) -> Response:
        folder = _run_folder(runs, run)
        if folder is None:
            return Response(status_code=404)
        named = {"Content-Disposition": 'attachment; filename="run.zip"'}
        return StreamingResponse(
            results.zip_of(folder), media_type="application/zip", headers=named
        )

    @ui.page("/")
    def index(run: Annotated[tuple[str, ...], Query()] = ()) -> None:
        named = [runs / name for name in run]
        shown = tuple(folder for folder in named if _is_known(runs, folder, jobs))
        _Page(jobs, fields, examples, runs, shown)

    return jobs


def _run_folder(runs: Path, name: str) -> Path | None:
    """The run's folder of that name; None unless it lies directly in the folder of runs."""
    folder = runs / name
    return folder if folder.parent == runs and folder.is_dir() and name not in ("", "..") else None


def _is_known(runs: Path, folder: Path, jobs: Jobs) -> bool:
    """Whether a folder is one of the runs; those that still wait have none."""
    return jobs.of(folder) is not None or _run_folder(runs, folder.name) == folder


class _Page:
    """One open window of the page: the form, the list of runs, and what is shown of them.

    `shown` are the runs that the address names: one to show, or several to compare.
    """

    def __init__(
        self, jobs: Jobs, fields: tuple[Field, ...], examples: Path, runs: Path,
        shown: tuple[Path, ...],
    ) -> None:  # fmt: skip
        self._jobs, self._runs = jobs, runs
        latest = jobs.all[-1].folder if jobs.all else None
        self._shown: Path | None = shown[0] if shown else latest
        self._compared: tuple[Path, ...] = shown if len(shown) > 1 else ()
        self._chosen: set[Path] = set(self._compared)
        self._state: tuple[Any, ...] = ()
        ui.colors(primary="#1f5f99")  # enough contrast for white letters
        ui.add_head_html('<script>document.documentElement.lang = "en"</script>')
        style = files("mammosim.serve").joinpath("style.css").read_text(encoding="utf-8")
        ui.add_css(f"{style}\n.mammosim {{ {pictures_css()} }}")
        self._draw(fields, examples)
        ui.timer(REFRESH_S, self._look)

    def _draw(self, fields: tuple[Field, ...], examples: Path) -> None:
        ui.label("mammosim").props("role=heading aria-level=1").classes("sr-only")
        with ui.row().classes("switch w-full gap-2 p-2"):
            for pane in ("configuration", "runs"):
                ui.button(pane, on_click=lambda _, to=pane: self._turn_to(to)).props("outline")
        with ui.element("div").classes("panes configuration") as self._panes:
            with ui.column().classes("configuration gap-2"):
                self._editor = Editor(fields, examples, self._start)
            with ui.column().classes("runs gap-2"):
                ui.label("Runs").classes("text-h6").props("role=heading aria-level=2")
                self._list = (
                    ui.element("div")
                    .classes("list")
                    .props('role=region aria-label="List of runs" tabindex=0')
                )
                with ui.row().classes("gap-2"):
                    self._compare_button = ui.button(
                        "Compare the chosen runs", on_click=self._compare
                    ).props("outline dense no-caps")
                    self._edit_button = ui.button(
                        "Edit this run's configuration", on_click=self._edit
                    ).props("outline dense no-caps")
                self._live = Live(self._cancel)
                self._results = ui.column().classes("w-full gap-2")

    def _turn_to(self, pane: str) -> None:
        """On a narrow screen, which has room for one."""
        self._panes.classes(replace=f"panes {pane}")

    def _start(self, values: dict[str, Any], title: str) -> None:
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in title)
        folder = self._runs / f"{name.strip('.') or 'run'}-{datetime.now():%Y%m%d-%H%M%S-%f}"
        config = folder.with_suffix(".yaml")
        self._runs.mkdir(parents=True, exist_ok=True)
        write_yaml(values, config)
        self._jobs.add(Job(folder, config))
        self._select(folder)
        self._turn_to("runs")

    def _edit(self) -> None:
        """Open the shown run's configuration in the form."""
        run = self._shown
        settings = results.record_of(run).get("settings") if run is not None else None
        if run is not None and settings:
            self._editor.take(settings, run.name, run)
            self._turn_to("configuration")

    def _cancel(self) -> None:
        job = self._jobs.of(self._shown) if self._shown else None
        if job is not None:
            job.cancel()

    def _select(self, folder: Path) -> None:
        self._shown, self._compared = folder, ()
        self._name_in_address(folder)
        self._look()

    def _choose(self, folder: Path, chosen: bool) -> None:
        (self._chosen.add if chosen else self._chosen.discard)(folder)
        self._compare_button.set_enabled(len(self._chosen) > 1)

    def _compare(self) -> None:
        """In the order of the list, the earliest first."""
        listed: tuple[Path, ...] = self._state[0]
        self._compared = tuple(run for run in reversed(listed) if run in self._chosen)
        self._name_in_address(*self._compared)
        self._look()

    def _name_in_address(self, *shown: Path) -> None:
        ui.run_javascript(f"({_NAME_RUNS})({json.dumps([run.name for run in shown])})")

    def _look(self) -> None:
        """Show what has changed since the last look."""
        self._jobs.advance()
        finished = results.runs_in(self._runs) if self._runs.is_dir() else []
        going = [job.folder for job in self._jobs.all if job.folder not in finished]
        every = tuple(dict.fromkeys([*reversed(going), *finished]))
        statuses = tuple(self._status(folder) for folder in every)
        state = (every, statuses, self._shown, self._compared)
        if state != self._state:
            self._state = state
            self._draw_list(every, statuses)
            self._draw_results()
        job = self._jobs.of(self._shown) if self._shown and not self._compared else None
        self._live.show(job)

    def _status(self, folder: Path) -> str:
        job = self._jobs.of(folder)
        return job.status if job is not None else results.status_of(folder)

    def _draw_list(self, every: tuple[Path, ...], statuses: tuple[str, ...]) -> None:
        self._list.clear()
        self._chosen &= set(every)
        self._compare_button.set_visibility(len(every) > 1)
        self._compare_button.set_enabled(len(self._chosen) > 1)
        with self._list:
            for folder, status in zip(every, statuses, strict=True):
                with ui.element("div").classes("line"):
                    box = ui.checkbox(
                        value=folder in self._chosen,
                        on_change=lambda change, of=folder: self._choose(of, bool(change.value)),
                    ).props("dense")
                    box.props["aria-label"] = f"Compare {folder.name}"
                    shown = folder == self._shown and not self._compared
                    ui.button(
                        f"{folder.name}: {status}", on_click=lambda _, to=folder: self._select(to)
                    ).props(f"no-caps dense {'' if shown else 'flat'}")
            if not every:
                ui.label("None yet.")

    def _draw_results(self) -> None:
        self._results.clear()
        run = self._shown
        has_record = run is not None and (run / "run.json").is_file()
        self._edit_button.set_visibility(has_record and not self._compared)
        with self._results:
            if self._compared:
                show_comparison([run for run in self._compared if (run / "run.json").is_file()])
            elif run is not None and has_record:
                show_run(run)

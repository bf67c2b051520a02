"""What the page shows of one run, of a run in progress, and of several side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from nicegui import ui

from mammosim.errors import InputError
from mammosim.serve import results, tables
from mammosim.serve.curves import Curves, Rows
from mammosim.serve.jobs import Job
from mammosim.serve.pictures import Shown, Wall

_FIT_FRAME = (
    "() => { const f = document.querySelector('iframe.planes-frame'); if (!f) return;"
    " const fit = () => { const d = f.contentDocument;"
    " if (d && d.body) f.style.height = d.body.scrollHeight + 4 + 'px'; };"
    " f.addEventListener('load', () => { fit();"
    " new ResizeObserver(fit).observe(f.contentDocument.body); }); }"
)


class Live:
    """A run in progress: its stage, expected end, curves, errors, and a button that cancels it."""

    def __init__(self, on_cancel: Callable[[], None]) -> None:
        with ui.column().classes("w-full gap-2") as self._all:
            self._said = ui.label().classes("text-subtitle1").props("role=status").mark("said")
            self._bar = ui.linear_progress(0.0, show_value=False)
            self._bar.props('aria-label="Progress of the run"')
            self._cancel = ui.button("Cancel, keep what was reached", on_click=on_cancel)
            self._errors = ui.column().classes("gap-0")
            with ui.column().classes("w-full gap-0") as self._curves_part:
                self._curves = Curves()

    def show(self, job: Job | None) -> None:
        """Show how far a job is; nothing without one."""
        self._all.visible = job is not None
        if job is None:
            return
        self._said.text = job.text
        self._bar.value = round(job.share, 3)
        self._cancel.visible = self._curves_part.visible = not job.is_over
        # A finished run's warnings are in its record, and shown with its results.
        lines = [line for line in job.said if not (job.is_over and line.startswith("warning: "))]
        if len(lines) != len(list(self._errors)):
            self._errors.clear()
            with self._errors:
                for line in lines:
                    ui.label(line).classes("note" if line.startswith("warning: ") else "alarm")
        if not job.is_over:
            self._curves.show(job.rows)


def show_run(run: Path) -> None:
    """A finished run: pictures, slider, tables, convergence and files."""
    for text in results.warnings_of(run):
        ui.label(text).classes("note text-caption")
    try:
        images = results.images_of(run)
        if images:
            Wall([("", [Shown(view, image) for view, image in images.items()])])
        _slider(run)
        _table(tables.views_table(run), "Views")
        _table(tables.lesions_table(run), "Lesions")
        histories = results.histories_of(run)
    except InputError as error:
        ui.label(str(error)).classes("alarm")
        histories = {}
    if histories:
        _convergence(histories)
    _files(run)


def _convergence(histories: Rows) -> None:
    """The curves, drawn when they are asked for: a chart that is removed while it loads fails."""
    part = ui.expansion("Convergence").classes("w-full")

    def draw() -> None:
        if part.value and not list(part):
            with part:
                Curves().show(histories)

    part.on_value_change(draw)


def _slider(run: Path) -> None:
    """The three planes from uncompressed to compressed, from the run's report."""
    if not results.planes_of(run):
        return
    frame = ui.element("iframe").classes("planes-frame")
    frame.props["src"] = f"/planes/{run.name}"
    frame.props["title"] = "From uncompressed to compressed"
    ui.run_javascript(f"({_FIT_FRAME})()")


def _files(run: Path) -> None:
    with ui.row().classes("gap-4 files"):
        if (run / "report.html").is_file():
            ui.link("Report", f"/file/{run.name}/report.html", new_tab=True)
        ui.link("All files as ZIP", f"/zip/{run.name}").props(f'download="{run.name}.zip"')
    with ui.expansion("Files").classes("w-full files"):
        for path in results.files_of(run):
            ui.link(path, f"/file/{run.name}/{path}", new_tab=path == "report.html")


def show_comparison(runs: Sequence[Path]) -> None:
    """Runs side by side: pictures with one window, differing settings, and results.

    Parameters
    ----------
    runs : sequence of Path
        Folders with a record.
    """
    ui.label(f"{len(runs)} runs side by side").props("role=heading aria-level=2").classes("text-h6")
    try:
        of_run = {run: results.images_of(run) for run in runs}
        views = sorted({view for images in of_run.values() for view in images})
        rows = [
            (view, [Shown(run.name, of_run[run][view]) for run in runs if view in of_run[run]])
            for view in views
        ]
        if rows:
            Wall(rows)
        settings = tables.compared_settings(runs)
        if settings:
            _table(settings, "Settings")
        else:
            ui.label("The settings of these runs are the same.")
        for view, html in tables.compared_views(runs).items():
            _table(html, view)
        _table(tables.compared_lesions(runs), "Lesions")
    except InputError as error:
        ui.label(str(error)).classes("alarm")


def _table(html: str, name: str) -> None:
    if html:
        held = ui.html(html, sanitize=False).classes("scroll")
        held.props(f'tabindex=0 role=region aria-label="Table: {name}"')

"""The configuration on the page: an example or a file, a form of every setting, and Run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import events, ui

from mammosim.config import parse_value, read_yaml
from mammosim.errors import InputError
from mammosim.serve.form import Field, as_text, by_field, checked, texts_of, values_of

FIRST = ("phantom", "compression", "views", "acquisition")
"""Sections of the form that are open at first."""

MAX_LETTERS = 500_000
"""Of a file that is opened: what a web socket carries."""

_READ_FILE = f"""async (event) => {{
  const file = event.target.files[0];
  if (file) emit({{ name: file.name, text: file.size > {MAX_LETTERS} ? null : await file.text() }});
  event.target.value = "";
}}"""


class Editor:
    """The form in one open window.

    Parameters
    ----------
    fields : tuple of Field
    examples : Path
        Folder of example configurations.
    on_run : callable
        Given the values and the name of a run to start.
    """

    def __init__(
        self,
        fields: tuple[Field, ...],
        examples: Path,
        on_run: Callable[[dict[str, Any], str], None],
    ) -> None:
        self._fields, self._examples, self._on_run = fields, examples, on_run
        self._opened: dict[str, Any] = {}
        self._folder = Path.cwd()
        self._inputs: dict[str, Any] = {}
        self._parts: dict[str, Any] = {}
        self._draw()
        self.open_example("quickstart")

    def _draw(self) -> None:
        ui.label("Configuration").classes("text-h6").props("role=heading aria-level=2")
        names = sorted(path.stem for path in self._examples.glob("*.yaml") if path.stem != "cohort")
        with ui.row().classes("items-end w-full gap-4"):
            ui.select(
                names, label="Choose an example", value="quickstart",
                on_change=lambda change: self.open_example(str(change.value)),
            ).classes("w-44")  # fmt: skip
            with ui.element("label").classes("text-caption"):
                ui.label("or open a configuration").classes("soft")
                chosen = ui.element("input").props('type=file accept=".yaml,.yml,.json"')
                chosen.classes("max-w-full")
                chosen.on("change", self._open_file, js_handler=_READ_FILE)
        self._name = ui.input("Name of the run", value="run").props("dense")
        with ui.row().classes("gap-2"):
            ui.button("Check", on_click=self._check).props("outline")
            ui.button("Run", on_click=self._start)
        self._problems = ui.column().classes("alarm gap-0").props("role=alert")
        for section in dict.fromkeys(field.path[0] for field in self._fields):
            with ui.expansion(section, value=section in FIRST).classes("w-full") as part:
                part.props("dense header-class=text-weight-medium")
                self._parts[section] = part
                for field in self._fields:
                    if field.path[0] == section:
                        self._inputs[field.key] = self._input(field)

    def _input(self, field: Field) -> Any:
        """An input for a field, with its key, description and default."""
        label = f"{field.label}  ({field.key})"
        default = f"default: {field.default}" if field.default else "not set"
        if field.kind in ("choice", "switch"):
            choices = field.choices or ("true", "false")
            entry: Any = ui.select({"": default, **{one: one for one in choices}}, label=label,
                                   value="")  # fmt: skip
        else:
            entry = ui.input(label, placeholder=default)
        entry.props("dense hide-bottom-space").classes("w-full")
        entry.mark(field.key)
        ui.label(field.text).classes("soft text-caption -mt-1 mb-1")
        return entry

    def open_example(self, name: str) -> None:
        """Fill the form with an example."""
        self.take(read_yaml(self._examples / f"{name}.yaml"), name, self._examples)

    def _open_file(self, event: events.GenericEventArguments) -> None:
        name, text = str(event.args["name"]), event.args["text"]
        if text is None:
            self._show_problems({}, [f"{name}: too large for a configuration"])
            return
        try:
            values = parse_value(str(text), name)
        except InputError as error:
            self._show_problems({}, list(error.problems))
            return
        self.take(values, Path(name).stem, Path.cwd())

    def take(self, values: Any, name: str, folder: Path) -> None:
        """Fill the form with a configuration; paths in it are relative to the folder."""
        if not isinstance(values, dict):
            self._show_problems({}, [f"{name}: expected a mapping of sections"])
            return
        self._opened, self._folder = values, folder
        texts = texts_of(values, self._fields)
        for field in self._fields:
            entry, text = self._inputs[field.key], texts.get(field.key, "")
            if isinstance(entry, ui.select) and text not in entry.options:
                entry.set_options({**entry.options, text: text})  # Check says what is allowed
            entry.value = text
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
                self._parts[key.partition(".")[0]].value = True
        self._problems.clear()
        with self._problems:
            for text in (*(f"{key}: {said}" for key, said in placed.items()), *others):
                ui.label(text)
        if placed:
            self._inputs[next(iter(placed))].run_method("focus")

    def _check(self) -> None:
        if self._values() is not None:
            ui.notify("The configuration is valid.", type="positive")

    def _start(self) -> None:
        values = self._values()
        if values is not None:
            self._on_run(values, str(self._name.value))

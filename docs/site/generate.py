"""Pages that follow from the package itself: settings from their fields, functions by docstrings.

Also puts every page of `explanation/` and `reference/` into the navigation under its own title, and
lets links to files of the repository that are no pages stand as plain text.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic_core import PydanticUndefined

import mammosim
from mammosim.cohort import CohortSettings
from mammosim.config import Settings, settings_in
from mammosim.pipeline import RunConfig

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent

sys.path.insert(0, str(Path(__file__).parent))  # of the module beside this one
from sources import sources_page  # noqa: E402

OUTSIDE = re.compile(
    r"\[([^\]]*)\]\(((?:\.\./)+(?:benchmarks|configs|mammosim|tests|[A-Z]+\.md)[^)]*)\)"
)
"""Links to what lies beside `docs/`."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Complete the navigation by the pages that are there."""
    nav = list(config.nav or [])
    nav.append(
        {"Explanation": [_entry(path) for path in sorted((DOCS / "explanation").glob("*.md"))]}
    )
    pages = [_entry(path) for path in sorted((DOCS / "reference").glob("*.md"))]
    made = [{"Settings": "reference/settings.md"}, {"Python": "reference/python.md"}]
    nav.append({"Reference": [*made, *pages, {"Sources": "reference/sources.md"}]})
    nav.append({"Changes": "changelog.md"})
    nav.append({"Contributing": "contributing.md"})
    config.nav = nav
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made here."""
    made = {
        "index.md": (ROOT / "README.md").read_text(encoding="utf-8"),
        "changelog.md": (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"),
        "contributing.md": (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"),
        "reference/settings.md": settings_page(),
        "reference/python.md": python_page(),
        "reference/sources.md": sources_page(),
    }
    for path in sorted((DOCS / "tutorials").glob("*.ipynb")):
        made[f"tutorials/{path.stem}.md"] = notebook_page(path)
    for name, text in made.items():
        if name.count("/") == 0:
            text = text.replace("](docs/", "](")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Links to files that are no pages: their path instead."""
    text = OUTSIDE.sub(lambda link: f"{link[1]} (`{link[2].lstrip('./')}`)", markdown)
    beside = r"\[([^\]]*)\]\(((?:benchmarks|configs|mammosim)/[^)]*|CITATION\.cff)\)"
    text = re.sub(beside, lambda link: f"{link[1]} (`{link[2]}`)", text)
    return text.replace("](CONTRIBUTING.md)", "](contributing.md)").replace(
        "](CHANGELOG.md)", "](changelog.md)"
    )


def notebook_page(path: Path) -> str:
    """A notebook's text and code, and where to get it."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    return "\n\n".join([*parts, f"The notebook is `docs/tutorials/{path.name}`."])


def settings_page() -> str:
    """Every key of a configuration with its text, default and limits."""
    lines = [
        "# Settings",
        "Every key of a run's configuration, in the order of the stages; then the section "
        "`cohort` of a cohort's file. Made from the package itself.",
    ]
    for name, field in RunConfig.model_fields.items():
        kind = settings_in(field.annotation)
        if kind is None or name == "views":
            continue
        lines += [f"## {name}", field.description or "", *_table(kind)]
    top = [name for name, field in RunConfig.model_fields.items()
           if name == "views" or settings_in(field.annotation) is None]  # fmt: skip
    lines += ["## At the top", *_table(RunConfig, top)]
    lines += ["## cohort", *_table(CohortSettings)]
    return "\n\n".join(lines)


def _table(kind: type[Settings], only: list[str] | None = None) -> list[str]:
    """A table of a section's keys, and the sections in it after it."""
    rows = ["| key | default | what it is |", "|---|---|---|"]
    below: list[str] = []
    for name, field in kind.model_fields.items():
        if only is not None and name not in only:
            continue
        text = " ".join((field.description or "").split()).replace("|", "\\|")
        limits = _limits(field)
        rows.append(f"| `{name}` | {_default(field)} | {text}{limits} |")
        inner = settings_in(field.annotation)
        if inner is not None and only is None:
            below += [f"### {name}", *_table(inner)]
    return ["\n".join(rows), *below]


def _limits(field: Any) -> str:
    words = {"ge": "from", "gt": "above", "le": "up to", "lt": "below"}
    said = [
        f"{word} {getattr(rule, key):g}"
        for rule in field.metadata
        for key, word in words.items()
        if isinstance(getattr(rule, key, None), int | float)
    ]
    schema: dict[str, Any] = {}
    if callable(field.json_schema_extra):
        field.json_schema_extra(schema)
    choices = schema.get("enum") or getattr(field.annotation, "__args__", ())
    if choices and all(isinstance(choice, str) for choice in choices):
        said.append("one of " + ", ".join(f"`{choice}`" for choice in choices))
    return f" *{', '.join(said)}*" if said else ""


def _default(field: Any) -> str:
    if field.default is PydanticUndefined:
        return "must be given" if field.default_factory is None else ""
    if field.default is None:
        return "–"
    if isinstance(field.default, Settings | tuple):
        return ""
    return f"`{str(field.default).lower() if field.default in (True, False) else field.default}`"


def python_page() -> str:
    """Every public name, from its docstring."""
    lines = ["# Python", "What `import mammosim` offers, from the docstrings."]
    for name in mammosim.__all__:
        home = getattr(mammosim, name).__module__
        lines.append(f"::: {home}.{name}")
    return "\n\n".join(lines)


def _entry(path: Path) -> dict[str, str]:
    title = path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ").replace("`", "")
    return {title: path.relative_to(DOCS).as_posix()}

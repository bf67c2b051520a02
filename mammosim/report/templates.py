"""The report's templates, in this folder."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template

from mammosim._wording import counted
from mammosim.report.quantities import number


@cache
def template(name: str) -> Template:
    """One of the templates: values are escaped, and a missing one is an error."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                              lstrip_blocks=True, loader=FunctionLoader(part))  # fmt: skip
    environment.filters["number"] = number
    environment.filters["counted"] = counted
    return environment.get_template(name)


def part(name: str) -> str:
    """One of the files in this package."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")

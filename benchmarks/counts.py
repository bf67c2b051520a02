"""How large, how documented and how typed the package's code is, as one line of a table.

    python benchmarks/counts.py [PACKAGE_FOLDER ...]

Printed for each package: lines of its modules (median, largest), lines of function bodies without
docstring (median, 95th percentile, largest), arguments of functions (95th percentile, largest),
the share of public modules, classes and functions with a docstring and their mean length in lines,
and the share of functions whose arguments and result all have a type.
"""

from __future__ import annotations

import ast
import statistics
import sys
from collections.abc import Iterator
from pathlib import Path

Function = ast.FunctionDef | ast.AsyncFunctionDef


def main() -> None:
    """Count the packages named on the command line, or mammosim beside this file."""
    for folder in sys.argv[1:] or [str(Path(__file__).parents[1] / "mammosim")]:
        print(count(Path(folder)))


def count(package: Path) -> str:
    """All counts of one package, in words."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(package.rglob("*.py"))]
    # Faces of packages only name what is elsewhere.
    lines = [
        len(path.read_text(encoding="utf-8").splitlines())
        for path in package.rglob("*.py")
        if path.name != "__init__.py"
    ]
    trees = [ast.parse(text) for text in texts]
    functions = [one for tree in trees for one in ast.walk(tree) if isinstance(one, Function)]
    bodies = [_body_lines(one) for one in functions]
    arguments = [len(_arguments(one)) for one in functions]
    documents = [ast.get_docstring(one) for tree in trees for one in _public(tree)]
    written = [text for text in documents if text]
    typed = [_is_typed(one) for one in functions]
    return (
        f"{package}: {len(lines)} modules, lines {_middle(lines)} / {max(lines)}; "
        f"{len(functions)} functions, body {_middle(bodies)} / {_p95(bodies)} / {max(bodies)}; "
        f"arguments {_p95(arguments)} / {max(arguments)}; "
        f"public documented {100 * len(written) / len(documents):.0f} %, "
        f"{statistics.mean(text.count(chr(10)) + 1 for text in written):.1f} lines; "
        f"fully typed {100 * sum(typed) / len(typed):.0f} %"
    )


def _middle(values: list[int]) -> int:
    return round(statistics.median(values))


def _p95(values: list[int]) -> int:
    return round(statistics.quantiles(values, n=20)[-1])


def _body_lines(function: Function) -> int:
    body = function.body
    if ast.get_docstring(function) is not None:
        body = body[1:]
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def _arguments(function: Function) -> list[ast.arg]:
    """Arguments but for `self` and `cls`."""
    parts = function.args
    found = [*parts.posonlyargs, *parts.args, *parts.kwonlyargs]
    return [one for one in found if one.arg not in ("self", "cls")]


def _is_typed(function: Function) -> bool:
    variable = [one for one in (function.args.vararg, function.args.kwarg) if one is not None]
    return function.returns is not None and all(
        one.annotation is not None for one in [*_arguments(function), *variable]
    )


def _public(tree: ast.Module) -> Iterator[ast.Module | ast.ClassDef | Function]:
    """A module, and its classes, functions and methods whose names have no underscore in front."""
    yield tree
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, Function | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                waiting += node.body


if __name__ == "__main__":
    main()

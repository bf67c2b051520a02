"""The house's own rules, checked on every module: where it may import from, and what it may say.

`pyproject.toml` has the order of the rooms; what import-linter cannot say is here.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "mammosim"
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
KERNELS = [name for name in MODULES if name.endswith("_kernels")]
KERNELS_MAY_IMPORT = {"__future__", "math", "typing", "numpy", "numba", "llvmlite"}
"""What a kernel module may import beside `mammosim._jit` and other kernel modules."""


@cache
def tree(name: str) -> ast.Module:
    return ast.parse(MODULES[name].read_text(encoding="utf-8"))


@cache
def offered(name: str) -> frozenset[str]:
    """Names in a module's `__all__`; none where it has none."""
    lists = [
        ast.literal_eval(node.value)
        for node in tree(name).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    return frozenset(*lists)


def imports(name: str) -> list[str]:
    """Modules that a module imports anywhere, also in functions and under TYPE_CHECKING."""
    found = []
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: found a relative import in line {node.lineno}"
            found += [_source(name, str(node.module), alias.name) for alias in node.names]
    return found


def _source(importer: str, package: str, name: str) -> str:
    """The module that a name comes from: the package, or the module of that name in it."""
    module = f"{package}.{name}"
    taken_from_it = package in MODULES and name in offered(package) and package != importer
    return module if module in MODULES and not taken_from_it else package


def room(name: str) -> str:
    """The first two parts of a module's name, as mammosim.phantom."""
    return ".".join(name.split(".")[:2])


def test_rooms_are_entered_through_their_init():
    """From outside a room only the names in its `__init__` can be imported."""
    bypassing = [
        f"{name} imports {imported}"
        for name in MODULES
        for imported in imports(name)
        if imported.startswith("mammosim.")
        and imported.count(".") > 1
        and room(imported) != room(name)
    ]
    assert bypassing == []


@pytest.mark.parametrize("name", sorted({room(name) for name in MODULES} - {"mammosim"}))
def test_what_a_room_offers_is_listed(name):
    """`__all__` of a room holds what its `__init__` imports: nothing hidden, nothing missing."""
    if MODULES[name].name != "__init__.py":
        pytest.skip("a room of one module")
    if name == "mammosim.cli":
        pytest.skip("its modules are imported to add their commands")
    imported = {
        alias.asname or alias.name
        for node in tree(name).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == offered(name)


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_import_only_kernels(name):
    foreign = [
        imported
        for imported in imports(name)
        if imported != "mammosim._jit"
        and imported not in KERNELS
        and imported.split(".")[0] not in KERNELS_MAY_IMPORT
    ]
    assert foreign == []


def test_compiled_code_is_in_kernel_modules():
    """Numba is set up in one place, and its decorators are used in kernel modules only."""
    for name in MODULES:
        if name in ("mammosim._jit", "mammosim._kernel_cache"):
            continue
        assert "numba" not in {imported.split(".")[0] for imported in imports(name)}, name
        decorated = [
            node.name
            for node in ast.walk(tree(name))
            if isinstance(node, ast.FunctionDef)
            and any("kernel" in ast.unparse(decorator) for decorator in node.decorator_list)
        ]
        assert not decorated or name in KERNELS, f"{name}: {decorated}"


def test_only_cohorts_load_scipy_stats():
    """It takes 0.4 s of a processor to load, a sixth of what a run loads."""
    users = {name for name in MODULES if "scipy.stats" in imports(name)}
    assert users == {"mammosim.cohort.distributions"}


def test_no_module_imports_itself_by_way_of_others():
    """No circles, whether or not they would be run: a type is imported from where it is made."""
    graph = {name: {each for each in imports(name) if each in MODULES} for name in MODULES}
    while removable := [name for name, others in graph.items() if not others & graph.keys()]:
        for name in removable:
            del graph[name]
    assert {name: others & graph.keys() for name, others in graph.items()} == {}


OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


@pytest.mark.parametrize("name", [name for name in MODULES if room(name) != "mammosim.cli"])
def test_only_the_command_line_speaks_of_options(name):
    """Lower rooms name keys and say what they found; `cli` puts them into options."""
    if name == "mammosim._jit":
        pytest.skip("LLVM's options")
    said = [
        (node.lineno, found)
        for node in ast.walk(tree(name))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        for found in OPTION.findall(node.value)
    ]
    assert said == []


EXACT = re.compile(r"_?[A-Z0-9]+_PER_[A-Z0-9]+")
"""Names of conversions between units, which need no word."""


def numbers(name: str) -> list[tuple[ast.Assign | ast.AnnAssign, int]]:
    """Assignments of numbers to constants of a module, and their places among its statements."""
    found = []
    for place, node in enumerate(tree(name).body):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [each.id for one in targets for each in ast.walk(one) if isinstance(each, ast.Name)]
        has_number = any(
            isinstance(each, ast.Constant) and type(each.value) in (int, float)
            for each in ast.walk(node.value)
        )
        value = ast.unparse(node.value)
        # Masks of bits; records, such as a kind of lesions, whose fields describe themselves.
        plain = "np.uint64(" in value or "__name__" in value or re.match("[A-Z][a-z]", value)
        plain = plain or all(map(EXACT.fullmatch, names))
        if has_number and not plain and all(each.lstrip("_").isupper() for each in names):
            found.append((node, place))
    return found


@pytest.mark.parametrize("name", MODULES)
def test_every_number_has_a_word_about_it(name):
    """A docstring below its group of lines, or a comment above or beside it."""
    body, lines = tree(name).body, MODULES[name].read_text(encoding="utf-8").splitlines()
    silent = []
    for node, place in numbers(name):
        last = place
        while (
            last + 1 < len(body)
            and isinstance(body[last + 1], ast.Assign | ast.AnnAssign)
            and body[last + 1].lineno == body[last].end_lineno + 1
        ):
            last += 1
        below = body[last + 1] if last + 1 < len(body) else None
        described = isinstance(below, ast.Expr) and below.lineno == body[last].end_lineno + 1
        first = node.lineno - 1
        while first > 0 and re.match(r"#|_?[A-Z]", lines[first - 1]):
            first -= 1
        beside = "".join(lines[first : node.end_lineno]).replace("# fmt: skip", "")
        if not described and "#" not in beside:
            silent.append(lines[node.lineno - 1])
    assert silent == []

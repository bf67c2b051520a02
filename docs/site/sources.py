"""The page of sources: every work that is cited anywhere, where, and how it was checked.

A citation is a name or names before a year, as `Siddon 1985`, `Day & Dance (1983)` or `Dance and
colleagues (1990, 2000)`, or one of the other forms that the bibliography gives for a work.
"""

from __future__ import annotations

import ast
import re
import unicodedata
from collections import defaultdict
from pathlib import Path

from mammosim.bibliography import Work, works

ROOT = Path(__file__).parents[2]

SCANNED = (
    "mammosim/**/*.py", "mammosim/**/*.yaml", "configs/**/*.yaml", "docs/**/*.md", "README.md",
    "benchmarks/*.py", "benchmarks/*.md", "tests/**/*.py",
)  # fmt: skip
"""Where works are cited. The change log is history."""

_YEAR = re.compile(r"\b(?:18|19|20)\d\d\b")
_NAME = r"(?:(?:de|den|van) )?[A-Z][A-Za-zÀ-ÿ]+(?:-[A-Z]?[a-zÀ-ÿ]+)*"
_BEFORE_YEAR = re.compile(
    rf"((?:{_NAME}, )*{_NAME}(?:,? (?:&|and) (?:{_NAME}|colleagues|co-workers))?)"
    r"(?:'s?)?(?: et al\.)?(?:'s?)?,? \(?$"
)
_FURTHER_YEAR = re.compile(r"(?:,|;| and) ((?:18|19|20)\d\d)\b")
_STANDARD = re.compile(r"\b(?:IEC \d{5}|ICRU Report \d+|ICRU-\d+|TG-\d+|RFC \d+|PubMed \d+)\b")

_ASSUMED = re.compile(r"\b(?:[Aa]ssumed|[Bb]y eye|from memory|[Cc]hosen\.|is a choice)")


def plain(text: str) -> str:
    """Text on one line: comment marks and the quotes between parts of a string taken away."""
    joined = re.sub(r'(?<!")"\s*\n\s*[fr]?"(?!")', "", text)
    return re.sub(r"\s*\n\s*(?:#:? *)?", " ", joined)


def scanned_files() -> list[Path]:
    """Files in which works may be cited."""
    return sorted({path for pattern in SCANNED for path in ROOT.glob(pattern)})


def citations(text: str) -> list[tuple[str, list[str]]]:
    """Citations in a text: as they are written, and the keys of works that each may mean.

    Examples
    --------
    >>> citations("the tables of Dance and colleagues (1990, 2000)")
    [('Dance and colleagues (1990', ['dance1990']), ('Dance and colleagues (2000', ['dance2000'])]
    """
    found = []
    for year in _YEAR.finditer(text):
        before = _BEFORE_YEAR.search(text[max(0, year.start() - 100) : year.start()])
        if before is None:
            continue
        names = re.split(r",? (?:&|and) |, ", before[1])
        years, end = [year[0]], year.end()
        while further := _FURTHER_YEAR.match(text, end):
            years.append(further[1])
            end = further.end()
        for one in years:
            keys = [_key(name, one) for name in names if name not in ("colleagues", "co-workers")]
            found.append((before[0] + one, keys))
    return found


def _key(name: str, year: str) -> str:
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z]", "", letters.lower()) + year


def cited() -> tuple[dict[str, set[str]], list[str]]:
    """Files that cite each work, by its key, and citations of works that are not listed."""
    where: dict[str, set[str]] = defaultdict(set)
    unknown = []
    forms = {form: key for key, work in works().items() for form in work.cited_as}
    for path in scanned_files():
        name, text = path.relative_to(ROOT).as_posix(), plain(path.read_text(encoding="utf-8"))
        for key in works():
            if f'"{key}"' in text:
                where[key].add(name)
        for form, key in forms.items():
            if form in text:
                where[key].add(name)
                if any(letter.isdigit() for letter in form):
                    text = text.replace(form, "")
        for written, keys in citations(text):
            known = [key for key in keys if key in works()]
            where.update({key: where[key] | {name} for key in known})
            if not known:
                unknown.append(f"{name}: {written}")
        unknown += [f"{name}: {standard}" for standard in _STANDARD.findall(text)]
    return where, unknown


def assumed() -> dict[str, list[str]]:
    """What the package says of values that it calls assumed, by file, with the values' names."""
    said = {}
    for path in scanned_files():
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        if name.startswith("mammosim/") and path.name != "keys.py":  # which repeat the settings
            found = _of_values(text) if path.suffix == ".py" else _of_comments(text)
            said[name] = [one for one in found if _ASSUMED.search(one)]
    return {name: found for name, found in said.items() if found}


def _of_values(source: str) -> list[str]:
    """Names of a module's constants and of its classes' fields, with what stands about them."""
    tree, lines = ast.parse(source), source.splitlines()
    bodies = [tree.body] + [node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    found = []
    for body in bodies:
        for node, after in zip(body, [*body[1:], None], strict=True):
            if not isinstance(node, ast.Assign | ast.AnnAssign):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            about = _comment_above(lines, node.lineno - 1)
            about += [line.split("#", 1)[1] for line in lines[node.lineno - 1 : node.end_lineno]
                      if "  # " in line and "fmt:" not in line]  # fmt: skip
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
                about.append(str(after.value.value))
            names = ", ".join(f"`{ast.unparse(target).strip('()')}`" for target in targets)
            found.append(f"{names}: {' '.join(' '.join(about).split())}")
    return found


def _comment_above(lines: list[str], row: int) -> list[str]:
    first = row
    while first > 0 and lines[first - 1].lstrip().startswith("#"):
        first -= 1
    return [line.strip().lstrip("#") for line in lines[first:row]]


def _of_comments(text: str) -> list[str]:
    """Sentences of the comments of a file of data."""
    comments = " ".join(line.split("#", 1)[1] for line in text.splitlines() if "#" in line)
    return [sentence.strip() for sentence in re.split(r"(?<=[.!?]) ", " ".join(comments.split()))]


def sources_page() -> str:
    """The page, in Markdown."""
    where, _ = cited()
    checked = [work for work in works().values() if work.checked]
    others = [work for work in works().values() if not work.checked]
    lines = [
        "# Sources",
        f"{len(works())} works are cited in code, configurations, tests and pages. This page is "
        "made from `mammosim/bibliography.toml` and from the places that cite them.",
        f"## Looked up ({len(checked)})",
        "In stored copies of public pages. Each entry says where, what was not shown there, and "
        "which of the numbers that are taken from the work were seen. Mostly only an abstract was "
        "read: where nothing else is said, tables, equations and figures were not compared.",
        "\n".join(_entry(work, where[work.key]) for work in checked),
        f"## Not confirmed ({len(others)})",
        "Looked for without success, or not looked up yet: these stand as the authors of the code "
        "know them. Neither the entries nor the numbers taken from them were checked.",
        "\n".join(_entry(work, where[work.key]) for work in others),
        "## Assumed",
        "Values that the code itself calls assumed, chosen by eye or from memory: these have no "
        "source.",
        "\n".join(
            f"* `{name}`\n" + "\n".join(f"    * {_escaped(one)}" for one in said)
            for name, said in sorted(assumed().items())
        ),
    ]
    return "\n\n".join(lines)


def _entry(work: Work, files: set[str]) -> str:
    text = work.citation
    if work.doi:
        text += f" [doi:{work.doi}](https://doi.org/{work.doi})."
    if work.checked:
        text += f" *Looked up:* {work.checked}."
    if work.numbers:
        text += f" *Numbers:* {work.numbers}."
    return f"* {text} *Cited in:* {', '.join(f'`{name}`' for name in sorted(files))}."


def _escaped(sentence: str) -> str:
    return re.sub(r"([*<>|\[\]])", r"\\\1", sentence)

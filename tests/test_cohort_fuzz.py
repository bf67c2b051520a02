"""Any configuration and any cohort: used, or refused in words; nothing else."""

from __future__ import annotations

import copy
import json
import tempfile
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mammosim.cohort import load_cohort
from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.pipeline import config_of, load_config, make_plan

CONFIGS = Path(__file__).parents[1] / "configs"
RUN, COHORT = (read_yaml(CONFIGS / f"{name}.yaml") for name in ("quickstart", "cohort"))

QUICK = settings(
    max_examples=40, deadline=None, derandomize=True, database=None,
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=12)
    | st.sampled_from(["../../x", "/dev/zero", "a" * 300, "$(touch pwned)", "é", "\0"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["choice", "uniform", "normal", "column", "within", "Float", "file"]),
            inner,
            max_size=3,
        )
    ),
    max_leaves=6,
)


def places(values, path=()):
    """Key paths of everything in plain values."""
    items = values.items() if isinstance(values, dict) else enumerate(values)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*path, key))


def changed(data, values):
    """The values with one of them another, or under another key."""
    values = copy.deepcopy(values)
    path = data.draw(st.sampled_from(list(places(values))))
    block = values
    for key in path[:-1]:
        block = block[key]
    if isinstance(block, dict) and data.draw(st.booleans()):
        block[data.draw(st.text(max_size=8))] = block.pop(path[-1])
    else:
        block[path[-1]] = data.draw(PLAIN)
    return values


def refused_in_words(action) -> None:
    problems: tuple[str, ...] = ("none",)
    try:
        action()
    except InputError as error:
        problems = error.problems
    assert problems
    assert all(line.strip() for line in problems)


@QUICK
@given(st.data())
def test_any_configuration(data):
    values = changed(data, RUN)
    refused_in_words(lambda: make_plan(config_of(values, Path("/nowhere"), "any.yaml")))


@QUICK
@given(st.data())
def test_any_cohort(data):
    values = changed(data, COHORT)

    def draw() -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cohort.json"
            path.write_text(json.dumps(values))
            cohort = load_cohort(path)
            cohort.config_of(cohort.patients - 1)

    refused_in_words(draw)


@QUICK
@given(st.binary(max_size=60), st.integers(0, 400))
def test_any_bytes_in_a_configuration(piece, at):
    content = (CONFIGS / "quickstart.yaml").read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.yaml"
        path.write_bytes(content[:at] + piece + content[at + len(piece) :])
        refused_in_words(lambda: load_config(path))

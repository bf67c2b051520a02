"""Public functions take settings as an object or as typed keywords, all in the same way."""

from __future__ import annotations

import ast
import inspect
from typing import Unpack, get_args, get_origin, get_type_hints

import make_keys
import numpy as np
import pytest
from make_run import FEW_PHOTONS

import mammosim
from mammosim import (
    AcquisitionSettings,
    CompressionSettings,
    GenerateSettings,
    InputError,
    ProjectionSettings,
    ReconstructionSettings,
    TomosynthesisSettings,
)
from mammosim.acquisition import lesion_visibility
from mammosim.config import Settings
from mammosim.pipeline import RunConfig

TAKES = {
    mammosim.generate_phantom: GenerateSettings,
    mammosim.compress: CompressionSettings,
    mammosim.project: ProjectionSettings,
    mammosim.project_arc: ProjectionSettings,
    mammosim.expose: AcquisitionSettings,
    mammosim.expose_arc: AcquisitionSettings,
    lesion_visibility: AcquisitionSettings,
    mammosim.reconstruct: ReconstructionSettings,
    mammosim.simulate: RunConfig,
}
"""Functions with settings, and of which kind."""


def test_every_public_function_with_keywords_is_in_the_table():
    functions = [getattr(mammosim, name) for name in mammosim.__all__]
    keyed = {
        one for one in functions if inspect.isfunction(one)
        and inspect.unwrap(one).__code__.co_flags & inspect.CO_VARKEYWORDS
    }  # fmt: skip
    assert keyed == TAKES.keys() - {lesion_visibility}


@pytest.mark.parametrize("package", make_keys.modules())
def test_keys_are_those_of_the_settings(package):
    """The generated file says what the settings say; `python tests/make_keys.py` renews it."""
    written = ast.parse(make_keys.path_of(package).read_text(encoding="utf-8"))
    made = ast.parse(make_keys.source(package))
    assert _statements(written) == _statements(made)


def _statements(tree: ast.Module) -> list[str]:
    """What a module says, imports sorted; lines may be broken anywhere."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            lines += [f"{node.module} {name.name}" for name in node.names]
    body = [node for node in tree.body if not isinstance(node, ast.ImportFrom)]
    return [*sorted(lines), *(" ".join(ast.unparse(node).split()) for node in body)]


@pytest.mark.parametrize("function", TAKES, ids=lambda function: function.__name__)
def test_signature_and_docstring_show_every_key(function):
    """At run time, as notebooks and `help` read them, and in the TypedDict, as editors do."""
    kind = TAKES[function]
    shown = inspect.signature(function).parameters
    hints = get_type_hints(inspect.unwrap(function)).values()
    typed = next(get_args(hint)[0] for hint in hints if get_origin(hint) is Unpack).__annotations__
    for name, field in kind.model_fields.items():
        assert name in shown
        assert name in typed or name in inspect.unwrap(function).__annotations__
        if not field.is_required() and name in typed:
            assert shown[name].default == field.get_default(call_default_factory=True)
        if name in typed:
            assert field.description
            assert field.description.splitlines()[-1] in function.__doc__
    assert not typed.keys() - kind.model_fields.keys()


def test_an_object_and_its_keywords_give_the_same(chain):
    """The whole chain twice; `mas`, `pixel_mm`, `thickness_mm` are far from their defaults."""
    one, other = (chain(as_object) for as_object in (True, False))
    np.testing.assert_array_equal(one.for_processing, other.for_processing)
    assert one.mas == 44.0


@pytest.fixture
def chain():
    def calls(as_object: bool) -> mammosim.Mammogram:
        def given(kind: type[Settings], **keys):
            return ((kind(**keys),), {}) if as_object else ((), keys)

        args, keys = given(GenerateSettings, density="dense", voxel_mm=4.0, volume_ml=300.0)
        breast = mammosim.generate_phantom(*args, seed=2, **keys)
        args, keys = given(
            CompressionSettings, model="springs", thickness_mm=50.0, resolution_mm=6.0
        )
        compressed = mammosim.compress(breast, "CC", *args, **keys)
        args, keys = given(ProjectionSettings, pixel_mm=2.0)
        paths = mammosim.project(compressed, *args, **keys)
        args, keys = given(AcquisitionSettings, mas=44.0, kvp=27.0, **FEW_PHOTONS)
        return mammosim.expose(paths, *args, seed=3, **keys)

    return calls


def test_a_series_without_a_grid_unless_asked_for(arc):
    """A settings object that says nothing of the grid is like keywords that say nothing of it."""
    silent = mammosim.expose_arc(arc, AcquisitionSettings(mas=60.0, **FEW_PHOTONS))
    assert not silent.middle.grid
    assert mammosim.expose_arc(
        arc, AcquisitionSettings(mas=60.0, grid=True, **FEW_PHOTONS)
    ).middle.grid
    np.testing.assert_array_equal(
        silent.projections,
        mammosim.expose_arc(arc, mas=60.0, **FEW_PHOTONS, grid=False).projections,
    )


@pytest.fixture(scope="module")
def arc():
    breast = mammosim.generate_phantom("b", 4.0, 1, volume_ml=300.0)
    compressed = mammosim.compress(breast, model="none")
    sweep = TomosynthesisSettings(view="CC", projections=3)
    return mammosim.project_arc(compressed, sweep, pixel_mm=3.0)


def test_an_arc_by_object_and_by_keys(arc):
    by_keys = mammosim.project_arc(arc.compressed, {"projections": 3}, pixel_mm=3.0)
    assert by_keys.settings == arc.settings
    assert by_keys.gantries == arc.gantries


CASES = [
    (lambda: mammosim.generate_phantom(GenerateSettings(), 2.0), "generate_phantom: found settings "
     "and the keywords voxel_mm, expected either"),
    (lambda: mammosim.compress(None, "CC", ProjectionSettings()), "found ProjectionSettings, "
     "expected CompressionSettings"),
    (lambda: mammosim.compress(None, "CC", CompressionSettings(), gravity=True), r"compress\(\): "
     "found settings and the keywords gravity"),
    (lambda: mammosim.project(None, 0.1), "project: settings: found float, expected Projection"),
    (lambda: mammosim.expose(None, {"mas": 3}), "found dict, expected AcquisitionSettings"),
    (lambda: mammosim.project(None, pixelmm=0.1), "unknown key; did you mean 'pixel_mm'"),
    (lambda: mammosim.compress(None, resolution_mm="1"), "compression.resolution_mm: found '1'"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), CASES)
def test_what_is_neither_an_object_nor_keywords_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()

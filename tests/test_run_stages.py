"""A run stage by stage: the same with and without an observer, and nothing it is given changes."""

from __future__ import annotations

import copy
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from make_run import FEW_PHOTONS

import mammosim
from mammosim import CompressionSettings, InputError
from mammosim.config import Settings, to_settings
from mammosim.phantom import make_phantom
from mammosim.pipeline import RunConfig, RunFolder, simulate_series, simulate_view

pytestmark = pytest.mark.usefixtures("breasts_are_made_once")

SECTIONS = {
    "phantom": {
        "generate": {"volume_ml": 250, "voxel_mm": 3.0},
        "lesions": [{"name": "ball", "kind": "mass", "diameter_mm": 20}],
    },
    "compression": {"model": "springs", "resolution_mm": 6.0, "thickness_mm": 45},
    "projection": {"pixel_mm": 1.0},
    "acquisition": FEW_PHOTONS,
    "targets": {"biopsy": {"view": "ML", "thickness_mm": 50}, "uncertainty": {"samples": 10}},
    "views": ["CC", {"view": "MLO", "thickness_mm": 50}, {"dbt": {"view": "CC", "projections": 3}}],
    "seed": 4,
}


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return to_settings(RunConfig, SECTIONS, "test")


@pytest.fixture(scope="module")
def told() -> list[tuple[str, str]]:
    return []


@pytest.fixture(scope="module")
def study(config, told, tmp_path_factory) -> mammosim.Study:
    output = RunFolder(tmp_path_factory.mktemp("run") / "out", config)

    def on_progress(view, stage, row):
        if row is None:
            told.append((view, stage))

    return mammosim.simulate(config, output, on_progress)


def test_views_without_an_observer_are_those_of_the_run(config, study):
    """The observer decides nothing: the stages alone give the same bits."""
    breast = make_phantom(config.phantom, config.laterality, config.seed)
    for view in config.resolved_views:
        alone = simulate_series if view.tomosynthesis else simulate_view
        one = alone(breast, view, config.seed)
        other = study.views[f"L{view.label}"]
        np.testing.assert_array_equal(one.mammogram.for_processing, other.mammogram.for_processing)
        np.testing.assert_array_equal(one.paths.length_mm, other.paths.length_mm)
        # Rows of the run's table also have the ellipsoids, which follow when all views are there.
        assert [target.shift_mm for target in one.targets] == [
            target.shift_mm for target in other.targets
        ]
        for mine, theirs in zip(one.lesion_images, other.lesion_images, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_sections_as_keywords_are_the_configuration(config, study):
    """Mappings and settings objects, and the caller's own mappings stay as they are."""
    given = copy.deepcopy(SECTIONS)
    given["compression"] = CompressionSettings(
        model="springs", resolution_mm=6.0, thickness_mm=45.0
    )
    given["targets"] = {}
    before = copy.deepcopy(given)
    other = mammosim.simulate(**given)
    assert given == before
    for name, view in study.views.items():
        np.testing.assert_array_equal(
            view.mammogram.for_processing, other.views[name].mammogram.for_processing
        )


def test_stages_are_told_of_in_order_and_timed(study, told):
    views = [name for name, _ in told if name]
    assert list(dict.fromkeys(views)) == ["LCC", "LMLO", "LCC_DBT"]
    first = [stage for name, stage in told if name == "LMLO"]
    assert first[:4] == ["compression", "projection", "acquisition", "targets"]
    assert [stage for name, stage in told if not name] == [
        "phantom", "lesion shift", "biopsy", "export", "report",
    ]  # fmt: skip
    timed = {f"{view}.{stage}" if view else stage for view, stage in told}
    within = {"biopsy", *(f"{name}.uncertainty" for name in study.views)}
    written = {f"{name}.{what}" for name in study.views for what in ("volumes", "export", "report")}
    assert (timed - within) | written == set(study.stage_seconds)


def test_a_study_is_not_changed(study):
    with pytest.raises(FrozenInstanceError):
        study.answers = None
    with pytest.raises(FrozenInstanceError):
        study.views["LCC"].mammogram = None


def test_a_run_resolves_its_settings_once(config, monkeypatch):
    """All settings of a view are made when the configuration is checked, none while it runs."""
    made: list[str] = []
    checked = Settings.model_validate_json.__func__

    def counted(cls, *arguments, **keys):
        made.append(cls.__name__)
        return checked(cls, *arguments, **keys)

    monkeypatch.setattr(Settings, "model_validate_json", classmethod(counted))
    again = to_settings(RunConfig, SECTIONS, "test")
    views, biopsies = 3, 3
    assert sorted(set(made)) == sorted(
        {"RunConfig", "CompressionSettings", "ProjectionSettings", "AcquisitionSettings"}
    )
    assert made.count("CompressionSettings") == views + biopsies
    assert made.count("ProjectionSettings") == made.count("AcquisitionSettings") == views
    made.clear()
    mammosim.simulate(again)
    assert made == []


def test_a_changed_copy_has_its_views_resolved_anew(config):
    changed = config.model_copy(update={"compression": CompressionSettings(resolution_mm=5.0)})
    assert [view.compression.resolution_mm for view in changed.resolved_views] == [5.0] * 3
    assert [view.compression.resolution_mm for view in config.resolved_views] == [6.0] * 3


def test_neither_or_both_of_configuration_and_sections_is_refused(config):
    with pytest.raises(InputError, match=r"simulate\(\): phantom: missing"):
        mammosim.simulate()
    with pytest.raises(InputError, match=r"found settings and the keywords seed"):
        mammosim.simulate(config, seed=3)

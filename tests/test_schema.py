"""The JSON Schemas of the configuration and of a cohort's file: what editors hold against."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from make_run import invoke

from mammosim.cohort import cohort_schema
from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, config_of


@pytest.mark.parametrize(
    "example", ["quickstart", "exam", "own_phantom", "victre", "tomosynthesis", "cohort"]
)
def test_schema_takes_what_the_examples_say_and_refuses_a_misprint(example):
    values = read_yaml(Path(__file__).parents[1] / "configs" / f"{example}.yaml")
    schema = json.loads(invoke("schema", *(["--cohort"] if example == "cohort" else [])).output)
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    assert not list(validator.iter_errors(values))
    values["compression"]["resolution_mn"] = 1.0
    assert list(validator.iter_errors(values))


@pytest.mark.parametrize(
    ("view", "sound"),
    [
        ("ML", True),
        ({"view": "CC", "thickness_mm": 50, "acquisition": {"kvp": 28}}, True),
        ({"dbt": "CC"}, True),
        ({"dbt": {"view": "CC", "projections": 9}}, True),
        ({"view": "CC", "dbt": {"projections": 9}}, True),
        ("LAT", False),
        ({"thickness_mm": 50}, False),
        ({"view": "CC", "thicknes_mm": 50}, False),
    ],
)
def test_schema_knows_every_way_to_say_a_view(view, sound):
    values = {"phantom": {"generate": {}}, "views": [view]}
    schema = RunConfig.model_json_schema()
    assert jsonschema.Draft202012Validator(schema).is_valid(values) == sound
    if sound:
        config_of(values, Path(), "here")
    else:
        with pytest.raises(InputError, match="views"):
            config_of(values, Path(), "here")


def test_schema_is_json_and_knows_every_section():
    result = invoke("schema")
    schema = json.loads(result.output)
    sections = {"phantom", "compression", "projection", "acquisition", "targets", "export"}
    assert sections <= set(schema["properties"])
    described = schema["$defs"]["CompressionSettings"]["properties"]["thickness_mm"]
    assert "mm" in described["description"]


@pytest.mark.parametrize(
    ("path", "value", "sound"),
    [
        (("phantom", "generate", "volume_ml"), {"uniform": [300, 900]}, True),
        (("phantom", "generate"), {"choice": [{"density": "a"}, {"density": "d"}]}, True),
        (("phantom", "lesions", 0, "position_mm"), [50, {"normal": [0, 5]}, 0], True),
        (("views", 0), {"choice": ["CC", "ML"]}, True),
        (("compression", "stiffness_kpa"), {"skin": {"uniform": [10, 60]}}, True),
        (("compression", "thickness_mm"), {"column": "thickness"}, True),
        (("compression", "thickness_mm"), {"uniformly": [40, 60]}, False),
        (("compression", "thickness_mm"), {"uniform": [40]}, False),
        (("seed",), {"uniform": [1, 9]}, False),
        (("cohort", "patients"), {"choice": [1, 2]}, False),
    ],
)
def test_a_cohort_takes_distributions_in_place_of_a_runs_values(path, value, sound):
    values = read_yaml(Path(__file__).parents[1] / "configs" / "cohort.yaml")
    block = values
    for key in path[:-1]:
        block = block[key]
    block[path[-1]] = value
    assert jsonschema.Draft202012Validator(cohort_schema()).is_valid(values) == sound

"""JSON Schema of a cohort's file: a run's, with a distribution allowed in place of any value."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import JsonSchemaMode, models_json_schema

from mammosim.cohort.distributions import KINDS
from mammosim.cohort.settings import CohortSettings
from mammosim.pipeline import RunConfig

MODE: JsonSchemaMode = "validation"
PLAIN = "seed"
"""The one key of a run that takes no distribution: patients' seeds follow from it."""


def cohort_schema() -> dict[str, Any]:
    """JSON Schema of a cohort's file.

    Returns
    -------
    dict
        As plain values.
    """
    run = RunConfig.model_json_schema(mode=MODE)
    own = {model: (model, MODE) for model in (CohortSettings, *KINDS.values())}
    references, definitions = models_json_schema(list(own.values()))
    laws = [references[own[model]] for model in KINDS.values()]
    schema: dict[str, Any] = _with(laws, run)
    schema["$defs"] = {name: _with(laws, one) for name, one in run["$defs"].items()}
    schema["$defs"] |= definitions["$defs"]
    schema["properties"][PLAIN] = run["properties"][PLAIN]
    schema["properties"]["cohort"] = references[own[CohortSettings]]
    schema["required"] = ["cohort", *run["required"]]
    schema |= {"title": "Cohort", "description": "Many virtual patients from one file."}
    return schema


def _with(laws: list[dict[str, Any]], schema: dict[str, Any]) -> dict[str, Any]:
    """A schema whose mappings and lists take any of the laws in place of what they hold."""

    def either(one: Any) -> Any:
        return {"anyOf": [_with(laws, one), *laws]} if isinstance(one, dict) else one

    changed = dict(schema)
    for key, inner in schema.items():
        if key == "properties":
            changed[key] = {name: either(one) for name, one in inner.items()}
        elif key in ("items", "additionalProperties"):
            changed[key] = either(inner)
        elif key == "prefixItems":
            changed[key] = [either(one) for one in inner]
        elif key == "anyOf":
            changed[key] = [_with(laws, one) for one in inner]
    return changed

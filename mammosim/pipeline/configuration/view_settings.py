"""A view of a run: its name, and values that hold for it alone."""

from __future__ import annotations

from copy import deepcopy
from typing import Any, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from mammosim.acquisition import AcquisitionSettings
from mammosim.compression import CompressionSettings
from mammosim.config import Settings
from mammosim.geometry import VIEW_NAMES, View
from mammosim.phantom import Side
from mammosim.projection import ProjectionSettings
from mammosim.reconstruction import SeriesSettings

VIEW_SECTIONS: dict[str, type[Settings]] = {
    "compression": CompressionSettings,
    "projection": ProjectionSettings,
    "acquisition": AcquisitionSettings,
}
"""Sections of which a view may have its own values."""


VIEW_TITLE = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
"""A view's own name, which becomes part of a folder's on any system."""


class ViewSettings(Settings):
    """One view, with its own values for keys of some sections."""

    view: Literal["CC", "MLO", "ML"]
    """Name of the view."""

    name: str | None = Field(default=None, pattern=VIEW_TITLE, max_length=32)
    """Name of the view in place of `CC`, `MLO` or `ML`, such as `CC_spot`; its folder is named by
    side and name. Needed if one view is made twice."""

    laterality: Side | None = None
    """Breast to image; default: each breast of the run."""

    dbt: SeriesSettings | None = None
    """Make the view a tomosynthesis series: how the tube moves, and what is reconstructed."""

    compression: dict[str, Any] = Field(default_factory=dict)
    """Keys of `compression` for this view only; they may also be given directly beside `view`."""

    projection: dict[str, Any] = Field(default_factory=dict)
    """Keys of `projection` for this view only; they may also be given directly beside `view`."""

    acquisition: dict[str, Any] = Field(default_factory=dict)
    """Keys of `acquisition` for this view only; they may also be given directly beside `view`."""

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """JSON Schema of what `_sorted_into_sections` takes: a name, or sections' keys as well."""
        names = {"enum": list(VIEW_NAMES)}
        schema = handler.resolve_ref_schema(handler(core_schema))
        mapping = deepcopy(schema)
        for kind in VIEW_SECTIONS.values():
            section = handler.resolve_ref_schema(handler(kind.__pydantic_core_schema__))
            mapping["properties"] |= deepcopy(section["properties"])
        series = mapping["properties"]["dbt"]["anyOf"]
        handler.resolve_ref_schema(series[0]).pop("required", None)  # its view stands outside, too
        series.append(names)
        del mapping["required"]
        mapping["anyOf"] = [{"required": ["view"]}, {"required": ["dbt"]}]
        schema.clear()
        schema["anyOf"] = [names, mapping]
        return schema

    @model_validator(mode="before")
    @classmethod
    def _sorted_into_sections(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {"view": value}
        if not isinstance(value, dict):
            return value
        entry = _with_its_series(dict(value))
        for section, kind in VIEW_SECTIONS.items():
            own = {key: entry.pop(key) for key in list(entry) if key in kind.model_fields}
            given = entry.get(section, {})
            if own and isinstance(given, dict):
                entry[section] = {**given, **own}
        if entry.get("dbt") is not None and isinstance(entry.get("acquisition", {}), dict):
            # Its lines would cut off oblique rays: no grid unless the view itself asks for one.
            entry["acquisition"] = {"grid": False, **entry.get("acquisition", {})}
        return entry

    @model_validator(mode="after")
    def _one_name(self) -> Self:
        if self.dbt is not None and self.dbt.view != self.view:
            raise ValueError(f"dbt.view: found {self.dbt.view}, expected {self.view} as in view")
        title = (self.name or "").upper()
        if title.endswith("_DBT") or title in {*VIEW_NAMES} - {self.view}:
            raise ValueError(
                f"name: found '{self.name}', which is what another view or a series is called"
            )
        return self

    @property
    def title(self) -> str:
        """The view's own name; empty where that is the usual one."""
        return "" if self.name in (None, self.view) else str(self.name)

    @property
    def label(self) -> str:
        """What the run calls the view, as `CC` or `CC_DBT`."""
        return View(self.view, "L", tomosynthesis=self.dbt is not None, title=self.title).label


def _with_its_series(entry: dict[str, Any]) -> dict[str, Any]:
    """A view whose name stands in `dbt` alone, or in both."""
    series = entry.get("dbt")
    if isinstance(series, str):
        series = {"view": series}
    if isinstance(series, dict):
        name = series.get("view", entry.get("view"))
        if name is not None:
            entry = {"view": name, **entry, "dbt": {"view": name, **series}}
    return entry

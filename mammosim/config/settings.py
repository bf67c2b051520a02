"""The ancestor of every section of a configuration."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Frozen settings that refuse unknown keys.

    Each field of a subclass is followed by one plain sentence with its unit; the sentence becomes
    the field's text in the JSON Schema and in the reference page.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False
    )

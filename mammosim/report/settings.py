"""The `report` section of a configuration."""

from __future__ import annotations

from pydantic import Field

from mammosim.config import Settings


class ReportSettings(Settings):
    """What a run says about itself."""

    html: bool = True
    """Write the report as one self-contained page."""

    picture_rows: int = Field(default=1400, ge=100, le=10_000)
    """Height that the report's pictures are reduced to, pixels; the files keep every pixel."""

    three_d: bool = True
    """Let the page show the breast in three dimensions; plotly.js in it adds 2 MB."""

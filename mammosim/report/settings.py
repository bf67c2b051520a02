"""The `report` section of a configuration."""

from __future__ import annotations

from pydantic import Field

from mammosim.config import Settings


class ReportSettings(Settings):
    """The report of a run."""

    html: bool = True
    """Write the report as one self-contained page."""

    picture_rows: int = Field(default=1400, ge=100, le=10_000)
    """Height to which the report's images are reduced, pixels; the files keep every pixel."""

    three_d: bool = True
    """Show the breast in three dimensions; this adds the 2 MB of plotly.js to the page."""

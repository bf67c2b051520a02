"""From pixels of a finished run back to the uncompressed breast."""

from mammosim.pipeline.locate.located_lines import locate_lines
from mammosim.pipeline.locate.saved_views import SavedView, read_views

__all__ = ["SavedView", "locate_lines", "read_views"]

"""From pixels of a finished run back to the uncompressed breast."""

from mammosim.pipeline.locate.in_run import LocatedInRun, locate_in_run
from mammosim.pipeline.locate.saved_views import SavedView, read_views

__all__ = ["LocatedInRun", "SavedView", "locate_in_run", "read_views"]

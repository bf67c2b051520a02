"""One run, in the order in which a mammogram is made."""

from mammosim.pipeline.run.simulation import Study, ViewResult, simulate

__all__ = ["Study", "ViewResult", "simulate"]

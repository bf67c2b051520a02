"""From path lengths to a mammogram: spectrum, scatter, detector, noise, dose, presentation."""

from mammosim.acquisition.detectors import DETECTORS, Detector
from mammosim.acquisition.expose import expose
from mammosim.acquisition.mammogram import Mammogram
from mammosim.acquisition.settings import AcquisitionSettings

__all__ = ["DETECTORS", "AcquisitionSettings", "Detector", "Mammogram", "expose"]

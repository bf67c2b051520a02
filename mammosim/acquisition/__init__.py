"""From path lengths to a mammogram: spectrum, scatter, detector, noise, dose, presentation."""

from mammosim.acquisition.detectors import DETECTORS, Detector
from mammosim.acquisition.dose import dose_limit_mgy
from mammosim.acquisition.expose import expose
from mammosim.acquisition.exposure_limits import magnification_warnings
from mammosim.acquisition.keys import AcquisitionKeys
from mammosim.acquisition.mammogram import Dose, GlandularDose, Mammogram
from mammosim.acquisition.named_files import check_acquisition
from mammosim.acquisition.presentation import present
from mammosim.acquisition.scatter import VOXEL_MM as SCATTER_VOXEL_MM
from mammosim.acquisition.scatter import DoseMap
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.tomosynthesis import Tomosynthesis, expose_arc
from mammosim.acquisition.visibility import Visibility, lesion_visibility

__all__ = [
    "DETECTORS",
    "SCATTER_VOXEL_MM",
    "AcquisitionKeys",
    "AcquisitionSettings",
    "Detector",
    "Dose",
    "DoseMap",
    "GlandularDose",
    "Mammogram",
    "Tomosynthesis",
    "Visibility",
    "check_acquisition",
    "dose_limit_mgy",
    "expose",
    "expose_arc",
    "lesion_visibility",
    "magnification_warnings",
    "present",
]

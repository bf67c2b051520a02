"""From path lengths to a mammogram: spectrum, scatter, detector, noise, dose, presentation."""

from mammosim.acquisition.mammogram import Mammogram

__all__ = ["Mammogram"]

"""What an exposure needs from files, asked before anything is compressed."""

from __future__ import annotations

from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.spectrum import make_beam
from mammosim.tissues import composition


def check_acquisition(settings: AcquisitionSettings) -> None:
    """Read the composition and the spectrum that the settings name.

    Parameters
    ----------
    settings : AcquisitionSettings
        With absolute paths.

    Raises
    ------
    InputError
        If a file is missing or its content cannot be used.
    """
    composition(settings.composition, settings.calcification)
    if settings.spectrum_file is not None:
        make_beam(
            settings.target, settings.filter, settings.kvp, spectrum_file=settings.spectrum_file
        )

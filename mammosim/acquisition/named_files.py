"""What an exposure needs from files, asked before anything is compressed."""

from __future__ import annotations

from mammosim.acquisition.attenuation import attenuation_per_mm
from mammosim.acquisition.grid_parts import check_grid
from mammosim.acquisition.monte_carlo import photon_tables
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.spectrum import make_beam
from mammosim.acquisition.tube import KVP_RANGE
from mammosim.tissues import composition


def check_acquisition(settings: AcquisitionSettings) -> None:
    """Read the composition and the spectrum that the settings name, and look through the filter.

    Parameters
    ----------
    settings : AcquisitionSettings
        With absolute paths.

    Raises
    ------
    InputError
        If a file is missing or its content cannot be used, no photon passes the filter, tables
        lack an element or an energy, or the grid needs a model that knows directions.
    """
    check_grid(settings)
    materials = composition(settings.composition, settings.calcification)
    # A voltage that is left out follows from the thickness: if none passes, the highest does not.
    highest = KVP_RANGE[1] if settings.spectrum_file is None else None
    beam = make_beam(
        settings.target, settings.filter, settings.kvp or highest,
        filter_mm=settings.filter_mm, paddle_mm=settings.paddle_mm,
        spectrum_file=settings.spectrum_file,
    )  # fmt: skip
    for material in materials.values():
        attenuation_per_mm(material, beam.energy_kev)
    if settings.scatter_model in ("monte-carlo", "kernels"):
        energy = beam.energy_kev
        photon_tables(list(materials.values()), float(energy[0]), float(energy[-1]))
    agent = settings.contrast
    if agent is not None:
        make_beam(settings.target, agent.filter, agent.kvp, filter_mm=agent.filter_mm)

"""What the anti-scatter grid lets through of primary and scatter in one exposure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.monte_carlo import Grid
from mammosim.acquisition.scatter import Scatter
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import Response
from mammosim.errors import InputError

NO_DIRECTIONS = (
    "acquisition.grid_scatter_transmission: found null, which needs scatter model monte-carlo and "
    "a breast; give the fraction of the scatter that the grid transmits"
)


def check_grid(settings: AcquisitionSettings) -> None:
    """Refuse a grid that needs directions from a scatter model that has none.

    Raises
    ------
    InputError
        If the scatter's part is left open and the model is not monte-carlo.
    """
    open_part = settings.grid and settings.grid_scatter_transmission is None
    if open_part and settings.scatter_model != "monte-carlo":
        raise InputError(NO_DIRECTIONS)


def grid_of(settings: AcquisitionSettings) -> Grid | None:
    """The grid's strips; None without a grid."""
    return Grid() if settings.grid else None


def primary_part(settings: AcquisitionSettings, unit: Response) -> float:
    """Part of the primary that reaches the detector through the grid.

    Parameters
    ----------
    settings : AcquisitionSettings
    unit : Response
        Its energies weigh the grid's transmission where the settings leave it to the strips.
    """
    grid = grid_of(settings)
    if grid is None:
        return 1.0
    if settings.grid_primary_transmission is not None:
        return settings.grid_primary_transmission
    along = grid.transmission(unit.energy_kev, np.ones(1), np.zeros(1))[:, 0, 0]
    return float(np.average(along, weights=unit.energy_weight[0]))


def scatter_behind_grid(
    scatter: Scatter, settings: AcquisitionSettings, inside: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Scatter signal behind the grid, [row, column], keV/(pixel mAs).

    Parameters
    ----------
    scatter : Scatter
    settings : AcquisitionSettings
    inside : ndarray of bool, [row, column]
        Cells of the breast: over them together, the part that the settings give is let through.

    Raises
    ------
    InputError
        If the settings leave the part to the photons' directions, which the model does not know.
    """
    part = settings.grid_scatter_transmission
    if not settings.grid:
        return scatter.signal
    if scatter.behind_grid is None:
        if part is None:
            raise InputError(NO_DIRECTIONS)
        return part * scatter.signal
    if part is None:
        return scatter.behind_grid
    chosen = inside if inside.any() else np.ones_like(inside)
    passed = scatter.behind_grid[chosen].sum()
    scale = part * scatter.signal[chosen].sum() / passed if passed > 0.0 else 0.0
    return scale * scatter.behind_grid

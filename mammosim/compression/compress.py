"""From an uncompressed breast to one between paddle and support."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Unpack

import numpy as np

from mammosim._jit import one_blas_thread
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.hyperelastic_model import compress_hyperelastic
from mammosim.compression.keys import CompressionKeys
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_model import compress_springs
from mammosim.compression.uncompressed import leave_uncompressed
from mammosim.config import documents_keys, given_settings
from mammosim.errors import Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held

MODELS: dict[str, Callable[..., CompressedBreast]] = {
    "springs": compress_springs,
    "hyperelastic": compress_hyperelastic,
    "none": leave_uncompressed,
}
"""Mechanical models by the name a configuration gives them."""


@one_blas_thread
@documents_keys(CompressionSettings, CompressionKeys)
def compress(
    breast: BreastPhantom,
    view: Literal["CC", "MLO", "ML"] | View = "CC",
    settings: CompressionSettings | None = None,
    *,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    **keys: Unpack[CompressionKeys],
) -> CompressedBreast:
    """Compress a breast between paddle and support.

    Parameters
    ----------
    breast : BreastPhantom
    view : {"CC", "MLO", "ML"} or View
        A name stands for that view of the breast's side, at the angle that the settings give.
    settings : CompressionSettings, optional
        How the breast is compressed; or give its keys as keywords.
    seed : int
        Seed of what is random (the visiting order of `relaxation`).
    watch : callable, optional
        Called with each row of the history, for progress.
    **keys
        Keys of `CompressionSettings`: ``model``, ``thickness_mm``, ``resolution_mm``, ...

    Returns
    -------
    CompressedBreast

    Raises
    ------
    InputError
        If a setting is wrong or does not fit the breast, or a lesion lies where this view does
        not hold the breast.
    NotConverged
        If the solver stopped before its tolerance; it carries what was reached.
    Interrupted
        If the user stopped it; it carries what was reached.
    """
    settings = given_settings(CompressionSettings, settings, keys, "compress()", ("compression",))
    if isinstance(view, str):
        view = View(view, breast.laterality, settings.mlo_angle_deg)
    held = as_held(breast, view.rotation[1])
    squeezed = MODELS[settings.model](held, view, settings, seed, watch)
    if squeezed.interrupted:
        raise Interrupted(f"{view.folder}: compression was interrupted", squeezed)
    if not squeezed.converged:
        raise NotConverged(f"{view.folder}: {_where_it_stopped(squeezed, settings)}", squeezed)
    return squeezed


def _where_it_stopped(squeezed: CompressedBreast, settings: CompressionSettings) -> str:
    """How far a solver came, in its own terms."""
    measures, iterations = squeezed.measures, squeezed.history.size
    if squeezed.model == "hyperelastic":
        return (
            f"hyperelastic stopped at an out-of-balance force of {measures['out_of_balance']:.3g} "
            f"(allowed {settings.force_tolerance:g}), smallest J {measures['smallest_j']:.3g}, "
            f"after {iterations} steps; " + (squeezed.notes[-1] if squeezed.notes else "")
        )
    return (
        f"{settings.solver} stopped at an estimated error of {measures['error_voxel']:.3g} "
        f"lattice units after {iterations} iterations"
    )

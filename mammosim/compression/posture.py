"""The breast without plates, pulled by its weight as the woman stands or lies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim._jit import one_blas_thread
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.unloading import hanging_breast, unload
from mammosim.compression.weight import hang
from mammosim.errors import Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, Posture, as_held

EXPERIMENTAL = (
    "the posture is experimental: with the moduli used for compression the breast moves less from "
    "prone to supine than in women"
)
"""What a user must know about every such result."""

FREE_OF_WEIGHT = "; the phantom's shape is taken as free of weight (phantom.shaped_under)"
"""What is to be added where the phantom's posture was not stated."""


@one_blas_thread
def in_posture(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    posture: Posture,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """A breast without plates under its weight, hanging from the chest wall or lying on it.

    Parameters
    ----------
    breast : BreastPhantom
        Its shape is free of weight, or that of the posture `shaped_under`.
    view : View
        Whose compression frame the elements have; nothing is compressed.
    settings : CompressionSettings
        Moduli, skin, fascia and resolution, of the model `hyperelastic`.
    posture : {"standing", "prone", "supine"}
    watch : callable, optional
        Called with each row of the history.
    lattice_shift : tuple of float
        As `compress_hyperelastic` takes it.

    Returns
    -------
    CompressedBreast
        Of the model `none`: no plates, but tissue has moved.

    Raises
    ------
    NotConverged
        If the solver stopped before its tolerance, or found no unloaded shape; it carries what was
        reached.
    Interrupted
        If the user stopped it.
    """
    held = as_held(breast, view.rotation[1])
    if held.shaped_under is None:
        hanging = hang(held, view, settings, posture, watch, lattice_shift)
        field = hanging.field
    else:
        rest = unload(held, view, settings, held.shaped_under, watch, lattice_shift)
        hanging = hang(rest.breast, view, rest.settings, posture, watch, lattice_shift)
        field = rest.followed_by(hanging.field)
    state = hanging.state
    converged = state.converged and not state.interrupted
    found = hanging_breast(held, hanging, field, posture, converged=converged)
    if state.interrupted:
        raise Interrupted(f"{posture}: the posture was interrupted", found)
    if not state.converged:
        raise NotConverged(
            f"{posture}: the breast under its weight stopped at an estimated error of "
            f"{hanging.error_mm[0]:.3g} mm (allowed {settings.tolerance_mm:g})",
            found,
        )
    return found


def posture_caution(breast: BreastPhantom) -> str:
    """What a user must know of the breast in a posture.

    Parameters
    ----------
    breast : BreastPhantom
        In any posture.

    Returns
    -------
    str
        One or two sentences: postures are experimental, and a breast without `shaped_under` is
        taken as free of weight.
    """
    return EXPERIMENTAL + (FREE_OF_WEIGHT if breast.shaped_under is None else "")

"""From an uncompressed breast to one between paddle and support."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Unpack

import numpy as np

from mammosim._interruption import until_kept
from mammosim._jit import one_blas_thread
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.credibility import believed
from mammosim.compression.hyperelastic_model import HYPERELASTIC
from mammosim.compression.keys import CompressionKeys
from mammosim.compression.model import MODELS
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_model import SPRINGS
from mammosim.compression.uncompressed import UNCOMPRESSED, held_before
from mammosim.compression.unloading import compress_unloaded
from mammosim.config import documents_keys, given_settings
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held

MODELS.update(springs=SPRINGS, hyperelastic=HYPERELASTIC, none=UNCOMPRESSED)


@until_kept()
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
        If the solver stopped before its tolerance, or reached what cannot be a result (see
        `mammosim.plausibility`); it carries what was reached.
    Interrupted
        If the user stopped it; it carries what was reached, or None if nothing was.
    """
    settings = given_settings(CompressionSettings, settings, keys, "compress()", ("compression",))
    if isinstance(view, str):
        view = View(view, breast.laterality, settings.mlo_angle_deg, spot=settings.spot)
    view = view_of_compressed(breast, view)
    held = as_held(breast, view.rotation[1])
    model = MODELS[settings.model]
    try:
        compressed = compress_unloaded(held, view, settings, seed, watch)
    except KeyboardInterrupt:  # where no solver has a state to keep
        raise Interrupted(f"{view.folder}: compression was interrupted", None) from None
    before = held_before(breast, view, model.compresses)
    compressed = replace(compressed, notes=(*compressed.notes, *before))
    if compressed.interrupted:
        raise Interrupted(f"{view.folder}: compression was interrupted", compressed)
    if not compressed.converged:
        reason = model.where_it_stopped(compressed, settings)
        raise NotConverged(f"{view.folder}: {reason}", compressed)
    return believed(compressed, settings)


def view_of_compressed(breast: BreastPhantom, view: View) -> View:
    """The view as it is taken of a breast that was compressed before, whose axes are its own.

    Raises
    ------
    InputError
        If the breast was compressed for another view.
    """
    if breast.compressed is None:
        return view
    held_for = breast.compressed.view
    if held_for not in (None, view.name):
        raise InputError(
            f"{view.folder}: {breast.source or 'the phantom'} was compressed for {held_for} "
            f"(phantom.compressed_for), so no other view of it can be made; found {view.name}"
        )
    return replace(view, in_compression_frame=True)

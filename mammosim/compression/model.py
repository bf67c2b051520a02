"""What a mechanical model is, and the table of models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class MechanicalModel:
    """All that the rest of the program asks about a mechanical model.

    Parameters
    ----------
    compress : callable
        ``compress(breast, view, settings, seed, watch, lattice_shift)`` gives a `CompressedBreast`;
        its `converged` and `interrupted` say how the solver ended.
    method : callable
        ``method(settings)``: model and solver in a few words, for the plan of a run.
    where_it_stopped : callable
        ``where_it_stopped(compressed, settings)``: how far a solver came that has not converged.
    quantities : callable
        ``quantities(compressed, settings)``: numbers to hold against the limits of
        `mammosim.plausibility`, by the names there.
    keeps_volume : bool
        Whether tissue keeps its volume, so that the breast is evenly thick between the plates.
    cautions : callable
        ``cautions(settings)``: sentences on what makes a result of these settings doubtful, which
        are known before anything is computed.
    foreseen : callable
        ``foreseen(coarse, settings)``: such numbers as a compression on a coarse lattice predicts
        for these settings, before the breast itself is compressed.
    own_keys : tuple of str
        Keys of `CompressionSettings` that other models do not know.
    usual : mapping
        Values of keys of `CompressionSettings` that are left out, where this model has others than
        the settings' class.
    chest_walls : tuple of str
        Values of the key `chest_wall` that it knows; the first is its default.
    compresses : bool
        Whether tissue is moved, so that plates press and the compression can be varied.
    frees_from_weight : bool
        Whether it can find the shape without weight of a breast that was shaped by it.
    bytes_per_node : float
        Memory, of the box around the lattice.
    seconds : callable
        ``seconds(settings, nodes)``: rough duration of one compression on two cores.
    sample_keys : mapping
        Settings of the samples of the uncertainty, in place of the user's.
    references : tuple of str
        Keys of `report.references` that a run with it cites.
    """

    compress: Callable[..., Any]
    method: Callable[[Any], str]
    where_it_stopped: Callable[[Any, Any], str]
    quantities: Callable[[Any, Any], Mapping[str, float]] = lambda compressed, settings: {}
    keeps_volume: bool = True
    cautions: Callable[[Any], tuple[str, ...]] = lambda settings: ()
    foreseen: Callable[[Any, Any], Mapping[str, float]] = lambda coarse, settings: {}
    own_keys: tuple[str, ...] = ()
    usual: Mapping[str, Any] = field(default_factory=dict)
    chest_walls: tuple[str, ...] = ("fixed", "sliding", "fascia")
    compresses: bool = True
    frees_from_weight: bool = False
    bytes_per_node: float = 0.0
    seconds: Callable[[Any, float], float] = lambda settings, nodes: 0.0
    sample_keys: Mapping[str, Any] = field(default_factory=dict)
    references: tuple[str, ...] = ()


MODELS: dict[str, MechanicalModel] = {}
"""Mechanical models by the name a configuration gives them; `compress` enters those there are.

It stands below the settings, which look a model's name up in it, and above nothing.
"""


def compressing_models(chest_wall: str = "fixed") -> list[str]:
    """Names of the models that move tissue and know a way to hold the chest wall.

    Parameters
    ----------
    chest_wall : str
        Way to hold it, as `fixed`, `sliding` or `fascia`.

    Returns
    -------
    list of str
        In the order of `MODELS`.

    Examples
    --------
    >>> from mammosim.compression import compressing_models
    >>> compressing_models("fascia")
    ['hyperelastic']
    """
    return [
        name
        for name, model in MODELS.items()
        if model.compresses and chest_wall in model.chest_walls
    ]

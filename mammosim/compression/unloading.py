"""The shape without weight of a breast whose voxels show it under its weight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.continuation import continued
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.hyperelastic.mesh import WALL
from mammosim.compression.hyperelastic_model import AIR_LAYERS
from mammosim.compression.model import MODELS
from mammosim.compression.settings import CompressionSettings, SkinSettings
from mammosim.compression.weight import HangingBreast, hang
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, Posture

MEAN_MM, LARGEST_MM = 0.05, 0.5
"""Distance from the voxels' shape at which the breast, loaded again, has come back to it: mean and
largest over the nodes of the elements. The voxels of the unloaded breast are a copy, whose rounding
moves single nodes near the surface by some tenths of a millimetre."""

MAX_PASSES = 15
"""Each takes one solution under weight; 4 to 6 are usual."""

EXPERIMENTAL_SHAPE = (
    "phantom.shaped_under is experimental: with the moduli used for compression a breast moves "
    "less under its weight than women's breasts do"
)
"""What a user must know about every such result."""

VOXELS_PER_ELEMENT = 4.0
"""Of the copy of the breast in its unloaded shape, along an edge; no finer than the phantom's."""

SPREAD = 0.8191725134 ** np.array([[1, 2, 3], [3, 1, 2], [2, 3, 1]])
"""Steps along x, y and z of the additive sequences that spread the points, one per voxel, at which
labels are taken: powers of 1/g with g^4 = g + 1. Taken at the voxels' centres, labels would lose or
gain a whole layer where the shape is shifted by half a voxel."""


@dataclass(frozen=True, eq=False)
class Unloaded:
    """A breast freed from its weight.

    Parameters
    ----------
    breast : BreastPhantom
        Its voxels in the unloaded shape; without lesions' and landmarks' names.
    field : DisplacementField
        Displacement from the phantom's shape to that one.
    settings : CompressionSettings
        As given, with the skin's thickness as the phantom's own voxels show it.
    modulus_kpa : ndarray of float32, [x, y, z]
        Of the elements on the phantom's shape.
    """

    breast: BreastPhantom
    field: DisplacementField
    settings: CompressionSettings
    modulus_kpa: NDArray[np.float32]

    def followed_by(self, loaded: DisplacementField) -> DisplacementField:
        """Displacement from the phantom's shape to that of the unloaded breast when loaded."""
        places, moved = _nodes(self.field), _moved(self.field)
        return _field_like(self.field, moved + _displaced(loaded, places + moved))


def unload(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    posture: Posture,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> Unloaded:
    """Find the shape from which the weight of a breast brings it to that of its voxels.

    Parameters
    ----------
    breast : BreastPhantom
        As it is held in the view (`as_held`).
    view : View
        Whose compression frame the elements have.
    settings : CompressionSettings
        Of the model `hyperelastic`.
    posture : {"standing", "prone", "supine"}
        Under whose weight its voxels show it.
    watch : callable, optional
        Called with each row of the history.
    lattice_shift : tuple of float
        As `compress_hyperelastic` takes it.

    Raises
    ------
    NotConverged
        If no such shape was found; it carries the breast as it last came back.
    Interrupted
        If the user stopped it.

    Notes
    -----
    Fixed-point iteration on the nodes x of the elements (as Sellier 2011, J Fluids Struct
    27:1461): with u the displacement of the shape X under
    its weight, X becomes X - (X + u(X) - x). Between two passes the voxels are carried to the new
    X, each to the nearest voxel's label. The step is halved where it brings the shape no nearer.
    """
    hanging = _solved(hang(breast, view, settings, posture, watch, lattice_shift), breast, posture)
    settings = _with_thickness(settings, hanging.skin_mm)
    here, modulus = hanging.field, hanging.mesh.elements.modulus
    places = _nodes(here)
    moved, step, before = -_moved(here), 1.0, np.inf
    for _ in range(MAX_PASSES):
        field = _field_like(here, moved)
        shape = _carried(breast, view, field, settings.resolution_mm)
        hanging = hang(shape, view, settings, posture, watch, lattice_shift)
        missed = moved + _displaced(_solved(hanging, breast, posture).field, places + moved)
        distance = np.linalg.norm(missed, axis=1)
        if distance.mean() <= MEAN_MM and distance.max() <= LARGEST_MM:
            return Unloaded(shape, field, settings, modulus)
        if distance.mean() > before:
            step *= 0.5
        before = float(distance.mean())
        moved = moved - step * missed
    raise NotConverged(
        f"phantom.shaped_under: found no shape without weight from which the breast, {posture}, "
        f"comes back to that of its voxels: after {MAX_PASSES} passes it is "
        f"{distance.mean():.2g} mm from it on average and {distance.max():.2g} mm at most (allowed "
        f"{MEAN_MM:g} and {LARGEST_MM:g} mm)",
        hanging_breast(breast, hanging, _field_like(here, missed), posture, converged=False),
    )


def compress_unloaded(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """Compress a breast by its model, freed from the weight that shaped it.

    Parameters
    ----------
    breast : BreastPhantom
        As it is held in the view (`as_held`).
    view : View
    settings : CompressionSettings
    seed, watch, lattice_shift
        As the models take them.

    Returns
    -------
    CompressedBreast
        Its field begins at the phantom's shape.

    Raises
    ------
    InputError
        If the breast is shaped by weight and the model cannot undo that, or plates hold it.
    NotConverged
        If no shape without weight was found.
    Interrupted
        If the user stopped that search.
    """
    model, posture = MODELS[settings.model], breast.shaped_under
    if posture is None or not model.compresses:
        found: CompressedBreast = model.compress(breast, view, settings, seed, watch, lattice_shift)
        return found
    _refuse_unsuited(breast, settings.model)
    rest = unload(breast, view, settings, posture, watch, lattice_shift)
    found = model.compress(rest.breast, view, rest.settings, seed, watch, lattice_shift)
    return replace(
        found, phantom=breast, field=rest.followed_by(found.field), modulus_kpa=rest.modulus_kpa,
        notes=(*found.notes, f"{view.folder}: {EXPERIMENTAL_SHAPE}"),
    )  # fmt: skip


def weightless(posture: str | None, model: str) -> list[str]:
    """What is wrong with freeing a breast from its weight before this model compresses it.

    Parameters
    ----------
    posture : str, optional
        Under whose weight the breast has its shape.
    model : str
        Name of the mechanical model.
    """
    if posture is None or not MODELS[model].compresses or MODELS[model].frees_from_weight:
        return []
    able = " or ".join(name for name, one in MODELS.items() if one.frees_from_weight)
    return [
        f"phantom.shaped_under: found {posture}, which needs compression.model: {able}; found "
        f"{model}, which finds no shape without weight"
    ]


def _refuse_unsuited(breast: BreastPhantom, model: str) -> None:
    problems = weightless(breast.shaped_under, model)
    if breast.compressed is not None:
        problems.append(
            f"phantom.shaped_under: found {breast.shaped_under} for a breast that plates hold "
            "already, so that they give it its shape, not its weight; leave it out"
        )
    if problems:
        raise InputError(problems)


def hanging_breast(
    breast: BreastPhantom,
    hanging: HangingBreast,
    field: DisplacementField,
    posture: Posture,
    *,
    converged: bool,
) -> CompressedBreast:
    """The record of a breast that only its weight moved, of the model `none`.

    Parameters
    ----------
    breast : BreastPhantom
        Whose voxels the field moves.
    hanging : HangingBreast
        Solution under its weight.
    field : DisplacementField
    posture : {"standing", "prone", "supine"}
    converged : bool
    """
    mean, largest = hanging.error_mm
    bottom, top = hanging.mesh.elements.height_mm
    return CompressedBreast(
        breast, hanging.view, "none", field, bottom, top, hanging.wall_mm, converged,
        {"force_n": 0.0, "error_mm": mean, "largest_error_mm": largest,
         "smallest_j": hanging.state.value.smallest},
        hanging.history, hanging.mesh.elements.notes, hanging.state.interrupted, posture=posture,
    )  # fmt: skip


def _solved(hanging: HangingBreast, breast: BreastPhantom, posture: Posture) -> HangingBreast:
    """The same; an error where the solver was stopped or did not converge."""
    if hanging.state.converged and not hanging.state.interrupted:
        return hanging
    found = hanging_breast(breast, hanging, hanging.field, posture, converged=False)
    if hanging.state.interrupted:
        raise Interrupted(f"{posture}: the search for the unloaded shape was interrupted", found)
    raise NotConverged(
        f"phantom.shaped_under: the breast under its weight ({posture}) stopped at an estimated "
        f"error of {hanging.error_mm[0]:.3g} mm",
        found,
    )


def _with_thickness(
    settings: CompressionSettings, thickness_mm: float | None
) -> CompressionSettings:
    """Settings whose skin has a stated thickness, since the copy's voxels do not show it."""
    if thickness_mm is None:
        return settings
    skin = settings.skin or SkinSettings()
    thick = skin.model_copy(update={"thickness_mm": thickness_mm})
    return settings.model_copy(update={"skin": thick})


def _nodes(field: DisplacementField) -> NDArray[np.float64]:
    """(n, 3) nodes of the tissue at rest, compression frame, mm."""
    return field.frame.position_mm(np.argwhere(field.tissue))


def _moved(field: DisplacementField) -> NDArray[np.float64]:
    """(n, 3) displacement of those nodes, compression frame, mm."""
    return field.displacement_mm[field.tissue].astype(np.float64)


def _displaced(field: DisplacementField, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) displacement of a field at places, both in the compression frame, mm."""
    return field.displacement_at(places @ field.rotation) @ field.rotation.T


def _field_like(field: DisplacementField, moved: NDArray[np.float64]) -> DisplacementField:
    """A field on the same nodes with other displacements (n, 3), continued into the air."""
    whole = np.zeros((3, *field.tissue.shape))
    whole[:, field.tissue] = moved.T
    whole = continued(whole, field.tissue, AIR_LAYERS, straight=1)
    whole[:, :WALL] = whole[:, WALL : WALL + 1]
    displacement = np.ascontiguousarray(np.moveaxis(whole, 0, -1), dtype=np.float32)
    return replace(field, displacement_mm=displacement)


def _carried(
    breast: BreastPhantom, view: View, field: DisplacementField, element_mm: float
) -> BreastPhantom:
    """The breast with its voxels carried by a field, each new voxel with the nearest label."""
    voxel_mm = max(float(breast.voxel_mm.max()), element_mm / VOXELS_PER_ELEMENT)
    reached = (_nodes(field) + _moved(field)) @ field.rotation
    wall_mm = float(_nodes(field)[:, 0].min())
    low = np.append(wall_mm, reached[:, 1:].min(axis=0) - voxel_mm)
    counts = np.ceil((reached.max(axis=0) + voxel_mm - low) / voxel_mm).astype(int)
    origin = low + 0.5 * voxel_mm
    labels = np.zeros(tuple(counts), np.uint8)
    plane = np.stack(np.meshgrid([0.0], *map(np.arange, counts[1:]), indexing="ij"), axis=-1)
    voxels = plane.reshape(-1, 3)
    for number in range(int(counts[0])):
        voxels[:, 0] = number
        inside = np.stack([voxels @ row for row in SPREAD], axis=-1) % 1.0 - 0.5
        points = origin + voxel_mm * (voxels + inside)
        labels[number] = _labels_at(breast, field, points).reshape(labels.shape[1:])
    nipple = breast.nipple_mm + field.displacement_at(breast.nipple_mm)[0]
    return replace(
        breast, labels=labels, voxel_mm=np.full(3, voxel_mm), origin_mm=origin, nipple_mm=nipple,
        lesions=(), landmarks=(), shaped_under=None,
    )  # fmt: skip


def _labels_at(
    breast: BreastPhantom, field: DisplacementField, points_mm: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Labels of the tissue that came to lie at points (n, 3), breast frame, mm; 0 for none."""
    inverse = field.inverse
    index = inverse.frame.index(points_mm @ field.rotation.T).T
    origin = np.stack(
        [
            map_coordinates(inverse.original_mm[..., axis], index, order=1, cval=np.nan)
            for axis in range(3)
        ],
        axis=-1,
    )
    known = np.isfinite(origin).all(axis=1)
    voxel = np.rint(breast.frame.index(np.where(known[:, None], origin, 0.0) @ field.rotation))
    inside = known & (voxel >= 0).all(axis=1) & (voxel < breast.labels.shape).all(axis=1)
    x, y, z = voxel[inside].astype(np.intp).T
    labels = np.zeros(len(points_mm), np.uint8)
    labels[inside] = breast.labels[x, y, z]
    return labels

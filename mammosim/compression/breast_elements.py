"""The elements of a breast in a view, with what holds it together: skin, fascia, fibres, weight."""

from __future__ import annotations

from mammosim.compression.hyperelastic.mesh import Mesh, Support, build_mesh
from mammosim.compression.plates import held_tissue
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_case import GRAVITY_M_S2
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, label_counts
from mammosim.tissues import SkinSheet


def elements_of(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    down: tuple[float, float, float] | None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """The elements of a breast in the compression frame of a view.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    settings : CompressionSettings
    down : tuple of float, optional
        Where weight pulls, breast frame; None: there is none.
    lattice_shift : tuple of float
        As `compress_hyperelastic` takes it.
    """
    support = Support(
        settings.wall, held_tissue(settings, breast)[1], skin_of(breast, settings),
        _fascia_of(settings), None if down is None else _gravity_of(view, down),
        settings.fibres.ratio,
    )  # fmt: skip
    return build_mesh(breast, view, settings.resolution_mm, settings.moduli, support, lattice_shift)


def skin_of(breast: BreastPhantom, settings: CompressionSettings) -> SkinSheet | None:
    """Skin as a sheet; None where it is a solid tissue or there is none.

    Parameters
    ----------
    breast : BreastPhantom
    settings : CompressionSettings

    Raises
    ------
    InputError
        If a sheet is asked for around a phantom without skin.
    """
    sheet = settings.skin_sheet
    labels = [label for label, name in breast.tissue_of_label.items() if name == "skin"]
    if sheet is None or label_counts(breast)[:, labels].any():
        return sheet
    if settings.skin is not None:
        raise InputError(
            f"compression.skin: found for {breast.source}, which has no skin voxels; remove this "
            f"key"
        )
    return None


def _fascia_of(settings: CompressionSettings) -> float:
    return settings.fascia_kpa_per_mm if settings.wall == "fascia" else 0.0


def _gravity_of(view: View, down: tuple[float, float, float]) -> tuple[float, float, float]:
    """Acceleration by gravity, compression frame, m/s2."""
    x, y, z = view.compression_from_breast(down) * GRAVITY_M_S2
    return float(x), float(y), float(z)

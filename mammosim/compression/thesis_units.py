"""The source thesis' way to say where plates and chest wall are, brought to millimetres.

The thesis counts voxels of the breast cropped to its tissue: z from the lowest layer, 0, upwards,
and x from the nipple, 0, to the chest wall, where the breast frame counts from there forward.
"""

from __future__ import annotations

from mammosim.compression.lattice import bounds_mm
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom


def in_millimetres(
    settings: CompressionSettings, breast: BreastPhantom, view: View
) -> CompressionSettings:
    """The same settings with `plates_voxel` as heights and depths in mm.

    Parameters
    ----------
    settings : CompressionSettings
    breast : BreastPhantom
        Its voxels are the unit.
    view : View

    Raises
    ------
    InputError
        If plates are given in voxels for another view than CC.

    Notes
    -----
    The thesis' UpperPlate and LowerPlate bound z from above and below, its platePosition is the x
    below which nodes lie between the plates, its chestPosition the x from which on they are held;
    a voxel's place is its centre.
    """
    given = settings.plates_voxel
    if given is None:
        return settings
    if view.name != "CC":
        raise InputError(
            f"compression.plates_voxel: found for the view {view.name}, but the thesis' units "
            f"apply to CC only; give thickness_mm or heights in mm for it"
        )
    low, high = bounds_mm(breast, view)
    voxel_x, _, voxel_z = breast.voxel_mm
    lowest, foremost = low[2] + 0.5 * voxel_z, high[0] - 0.5 * voxel_x
    changes = {
        "plates_voxel": None,
        "support_z_mm": float(lowest + given.lower * voxel_z),
        "paddle_z_mm": float(lowest + given.upper * voxel_z),
    }
    if given.edge is not None:
        changes["plate_edge_mm"] = float(foremost - given.edge * voxel_x)
    if given.chest_wall is not None:
        changes["chest_wall_mm"] = float(foremost - given.chest_wall * voxel_x)
    return settings.model_copy(update=changes)

"""The compressed breast as VICTRE keeps it, for MC-GPU and whatever reads its phantoms.

VICTRE's pipeline compresses ``p_N`` with FEBio to ``pc_N`` (breastCompress.cxx), crops it at the
paddles to ``pc_N_crop``, and with lesions in it calls it ``pcl_N`` (Pipeline.py of
DIDSR/VICTRE_PIPELINE); MC-GPU takes either of the latter. Here the lesions are in the breast before
it is compressed, so that both stages are there at once.
"""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.export.atomic import write_text
from mammosim.export.label_files import table_of_compressed, write_label_files
from mammosim.export.metaimage_files import write_metaimage
from mammosim.export.whole_voxels import to_whole_voxels
from mammosim.geometry import VoxelFrame
from mammosim.phantom import LESION_KINDS
from mammosim.tissues import TISSUES

PADDLE_LABEL = 50
"""VICTRE's label of both paddles, polystyrene in its list of materials (Constants.py)."""

PADDLE_MM = 1.0
"""Thickness of VICTRE's paddles, mm (`paddleHeight` of breastCompress.cxx)."""


def write_victre(
    compressed: CompressedBreast,
    labels: NDArray[np.uint8],
    frame: VoxelFrame,
    folder: str | PathLike[str],
    seed: int,
) -> None:
    """Write a compressed breast with its plates under VICTRE's names.

    Parameters
    ----------
    compressed : CompressedBreast
    labels : ndarray of uint8, [x, y, z]
        Labels of the compressed breast, axes of the compression frame.
    frame : VoxelFrame
        Where those voxels are, compression frame, mm.
    folder : path
        VICTRE's folder of results; files go into its folder `seed`, as VICTRE has it.
    seed : int
        VICTRE's N.

    Raises
    ------
    InputError
        If a file cannot be written.

    Notes
    -----
    ``pc_N`` is the whole breast between its plates; ``pcl_N`` (``pc_N_crop`` where no lesion is in
    it) the part from the plates' edge on and from the lower plate to the upper one. Voxels are
    in the compression frame: x anterior, z from the breast support to the paddle.

    ``pc_N.loc`` has a line ``x,y,z`` in mm for each lesion; ``pcl_N.loc`` a line of whole numbers
    ``z x y type`` in voxels of ``pcl_N`` for each mass (2) and cluster of calcifications (1), as
    VICTRE's `insert_lesions` writes them. The plates are flat, where VICTRE's have an edge of 3 mm
    radius and a lip; as in VICTRE they are only where there is air, so that tissue which stands
    out beyond its lattice node by half a cell dents them. A lesion's voxels carry the label of its
    tissue; that calcifications may fill only part of a voxel is lost. Voxels that septa fill in
    part become ligament or fat as a whole, as many as keep the septa's volume.
    """
    folder = Path(folder) / str(seed)
    whole, grid = _between_plates(compressed, labels, frame)
    places = _lesion_places_mm(compressed)
    write_metaimage(whole, grid, folder / f"pc_{seed}.mhd")
    part, corner = _cropped(compressed, whole, grid)
    inserted = _inserted(compressed, places, corner)
    name = f"pcl_{seed}" if inserted else f"pc_{seed}_crop"
    write_metaimage(part, corner, folder / f"{name}.mhd")
    if inserted:
        write_text(folder / f"{name}.loc", inserted)
    # Lesions have their tissue's label here, and both volumes lie along the compression frame.
    table = replace(
        table_of_compressed(compressed), lesions={}, in_patient_axes=False,
        tissue_of_value={PADDLE_LABEL: "air"} | {t.label: t.name for t in TISSUES.values()},
    )  # fmt: skip
    write_label_files(table, (f"pc_{seed}.mhd", f"{name}.mhd"), folder, colours=False)
    if len(places):
        lines = [",".join(f"{value:E}" for value in place) for place in places]
        write_text(folder / f"pc_{seed}.loc", "".join(f"{line}\n" for line in lines))


def _between_plates(
    compressed: CompressedBreast, labels: NDArray[np.uint8], frame: VoxelFrame
) -> tuple[NDArray[np.uint8], VoxelFrame]:
    """The breast in VICTRE's labels on a grid that holds both plates, with the plates."""
    tissue_label = np.zeros(256, np.uint8)
    for label, tissue in compressed.phantom.tissue_of_label.items():
        tissue_label[label] = TISSUES[tissue].label
    step = frame.spacing_mm[2]
    faces = frame.origin_mm[2] + step * (np.array([0, frame.shape[2]]) - 0.5)
    below = compressed.support_z_mm - PADDLE_MM
    above = compressed.paddle_z_mm + PADDLE_MM
    pad = [max(0, int(np.ceil((faces[0] - below) / step))),
           max(0, int(np.ceil((above - faces[1]) / step)))]  # fmt: skip
    nx, ny, nz = frame.shape
    origin = frame.origin_mm - [0.0, 0.0, pad[0] * step]
    grid = VoxelFrame(origin, frame.spacing_mm, (nx, ny, nz + sum(pad)))
    out = np.zeros(grid.shape, np.uint8)
    np.take(tissue_label, labels, out=out[:, :, pad[0] : pad[0] + nz])
    to_whole_voxels(out)
    under = _first_under_plates(compressed, grid)
    for layer in _plate_layers(compressed, grid):
        slab = out[under:, :, layer]
        slab[slab == 0] = PADDLE_LABEL
    return out, grid


def _first_under_plates(compressed: CompressedBreast, grid: VoxelFrame) -> int:
    """Index of the first voxel along x whose centre lies at the plates' edge or beyond."""
    index = (compressed.plate_edge_mm - grid.origin_mm[0]) / grid.spacing_mm[0]
    return int(np.clip(np.ceil(index - 1e-9), 0, grid.shape[0] - 1))


def _plate_layers(compressed: CompressedBreast, grid: VoxelFrame) -> NDArray[np.intp]:
    """Indices along z of voxels whose centres lie in either plate, ascending."""
    z = grid.origin_mm[2] + grid.spacing_mm[2] * np.arange(grid.shape[2])
    lower = (z >= compressed.support_z_mm - PADDLE_MM) & (z < compressed.support_z_mm)
    upper = (z > compressed.paddle_z_mm) & (z <= compressed.paddle_z_mm + PADDLE_MM)
    # Voxels thicker than a plate may have no centre in it: the nearest one outside stands for it.
    if not lower.any():
        lower[max(int(np.searchsorted(z, compressed.support_z_mm)) - 1, 0)] = True
    if not upper.any():
        upper[min(int(np.searchsorted(z, compressed.paddle_z_mm, "right")), len(z) - 1)] = True
    return np.flatnonzero(lower | upper)


def _cropped(
    compressed: CompressedBreast, whole: NDArray[np.uint8], grid: VoxelFrame
) -> tuple[NDArray[np.uint8], VoxelFrame]:
    """From the plates' edge on, and from the lowest layer of a plate to the highest."""
    layers = _plate_layers(compressed, grid)
    start = np.array([_first_under_plates(compressed, grid), 0, int(layers[0])])
    part = whole[start[0] :, :, layers[0] : layers[-1] + 1]
    nx, ny, nz = part.shape
    return part, VoxelFrame(grid.position_mm(start), grid.spacing_mm, (nx, ny, nz))


def _lesion_places_mm(compressed: CompressedBreast) -> NDArray[np.float64]:
    """(n, 3) where each lesion's centre came to lie, compression frame, mm."""
    lesions = compressed.phantom.lesions
    if not lesions:
        return np.empty((0, 3))
    before = np.array([lesion.position_mm for lesion in lesions])
    after = before + compressed.displacement_at(before)
    return compressed.view.compression_from_breast(after)


def _inserted(
    compressed: CompressedBreast, places_mm: NDArray[np.float64], frame: VoxelFrame
) -> str:
    """Lines of `pcl_N.loc`: lesions of which VICTRE has a number, and whose centre is there."""
    lines = []
    for lesion, place in zip(compressed.phantom.lesions, places_mm, strict=True):
        index = np.rint(frame.index(place)).astype(int)
        inside = (index >= 0).all() and (index < frame.shape).all()
        victre_type = LESION_KINDS[lesion.kind].victre_type
        if victre_type is not None and inside:
            x, y, z = index
            lines.append(f"{z} {x} {y} {victre_type}\n")
    return "".join(lines)

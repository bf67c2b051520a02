"""A MATLAB file of the compressed lattice: where each node went, its tissue, and how it came there.

The thesis that the spring model comes from saved its coordinates, springs, parameters and
convergence for MATLAB; this file holds the same under plain names.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from mammosim.compression import CompressedBreast
from mammosim.export.atomic import whole_file
from mammosim.export.tables import compression_summary

HEADER_BYTES = 116
"""Length of a MAT-file's text (MathWorks, MAT-File Format, Level 5: header), where SciPy writes
the time of day."""

HEADER = b"MATLAB 5.0 MAT-file, written by mammosim"


def write_matlab(compressed: CompressedBreast, path: str | PathLike[str]) -> None:
    """Write the lattice of a compressed breast for MATLAB.

    Parameters
    ----------
    compressed : CompressedBreast
    path : path
        Ends in ``.mat``.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    MAT-file of level 5, compressed; MATLAB's ``load``, Octave and ``scipy.io.loadmat`` read it.

    =============  ===================================================================
    x, y, z        place of each node under the plates, compression frame, mm, [x, y, z]
    x0, y0, z0     its place at rest along each axis, mm
    tissue         whether a node is tissue, [x, y, z]
    label          label of the phantom's voxel at each tissue node, [x, y, z]; their names are
                   the fields of `tissue_of_label`, as ``label_29``
    modulus_kpa    Young's modulus of each node's springs at rest, or of each element, kPa
    parameters     plates and measures, the scalars of ``compression.json``
    convergence    the solver's history, a column a field
    =============  ===================================================================

    Places of nodes in air are a smooth continuation without meaning. Along x the first layer (1
    in MATLAB) is air behind the chest wall.
    """
    frame = compressed.field.frame
    at_rest = [
        origin + spacing * np.arange(count)
        for origin, spacing, count in zip(
            frame.origin_mm, frame.spacing_mm, frame.shape, strict=True
        )
    ]
    moved = compressed.field.displacement_mm
    places = [
        (rest.reshape([-1 if other == axis else 1 for other in range(3)]) + moved[..., axis])
        for axis, rest in enumerate(at_rest)
    ]
    summary = compression_summary(compressed)
    variables = {
        **{name: place.astype(np.float32) for name, place in zip("xyz", places, strict=True)},
        **{f"{name}0": rest for name, rest in zip("xyz", at_rest, strict=True)},
        "tissue": compressed.field.tissue,
        "label": _node_labels(compressed),
        "tissue_of_label": {
            f"label_{label}": name for label, name in compressed.phantom.tissue_of_label.items()
        },
        "parameters": {key: value for key, value in summary.items() if key != "notes"},
        "convergence": {
            name: np.ascontiguousarray(compressed.history[name])
            for name in compressed.history.dtype.names or ()
        },
    }
    if compressed.modulus_kpa is not None:
        variables["modulus_kpa"] = compressed.modulus_kpa
    with whole_file(path) as part:
        savemat(part, variables, do_compression=True, long_field_names=True, oned_as="column")
        _without_time(part)


def _node_labels(compressed: CompressedBreast) -> NDArray[np.uint8]:
    """Label of the phantom's voxel at each tissue node, 0 elsewhere."""
    field, phantom = compressed.field, compressed.phantom
    nodes = np.argwhere(field.tissue)
    points = compressed.view.breast_from_compression(field.frame.position_mm(nodes))
    voxels = np.rint(phantom.frame.index(points)).astype(np.intp)
    voxels = np.clip(voxels, 0, np.array(phantom.labels.shape) - 1)
    labels = np.zeros(field.tissue.shape, np.uint8)
    labels[tuple(nodes.T)] = phantom.labels[tuple(voxels.T)]
    return labels


def _without_time(path: Path) -> None:
    """Put a fixed text where SciPy has written the time of day."""
    with path.open("r+b") as stream:
        stream.write(HEADER.ljust(HEADER_BYTES))

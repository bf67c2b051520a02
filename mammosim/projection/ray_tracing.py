"""The tracer as one function of arrays: labels, nodes and rays in, lengths out.

Everything before it is geometry, everything after it is physics of single channels. Another way to
trace, as on a graphics card, takes the place of `trace_rays` and nothing else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._side_by_side import dealt
from mammosim.projection._ray_kernels import LABELS_PER_WORD, Beam, Voxels, find_empty_cells, trace

# Rows that one thread traces together: neighbouring rays share the voxels in its cache.
_BAND_ROWS = 64


def trace_rays(
    labels: NDArray[np.uint8],
    channel_of_label: NDArray[np.int64],
    channels: int,
    nodes: NDArray[np.float32],
    beam: Beam,
    *,
    weighted: bool = True,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Length of each channel along the ray to each pixel, plain and times density.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Voxels of the uncompressed breast.
    channel_of_label : ndarray of int64, (256,)
        Channel that each label is added to; `channels` where it is not wanted.
    channels : int
        Number of channels.
    nodes : ndarray of float32, [x, y, z, 4]
        Inverse map on its grid: fractional voxel of each node plus a half, and density.
    beam : Beam
        Focal spot, detector and pixels in units of that grid.
    weighted : bool
        Whether densities count; without them both results are one array.

    Returns
    -------
    length, weighted_length : ndarray of float32, [channel, row, column]
        mm. The same bits for any number of threads.
    """
    rows, columns = beam.row_v.size, beam.column_u.size
    # Pages of zeros that no ray writes to take no memory.
    length = np.zeros((channels, rows, columns), dtype=np.float32)
    weighted_length = length
    if weighted:
        weighted_length = np.zeros(length.shape, dtype=np.float32)  # zeros_like would write
    else:
        nodes = nodes.copy()
        nodes[..., 3] = 1.0
    bands = -(-rows // _BAND_ROWS)
    voxels = _voxels(labels, channel_of_label, channels, nodes)
    trace(dealt(bands), _BAND_ROWS, beam, nodes, voxels, length, weighted_length)
    return length, weighted_length


def _voxels(
    labels: NDArray[np.uint8],
    channel_of_label: NDArray[np.int64],
    channels: int,
    nodes: NDArray[np.float32],
) -> Voxels:
    """The labels as the kernel wants them; copied only where they do not lie as it needs them."""
    labels = np.ascontiguousarray(labels)
    if labels.ctypes.data % LABELS_PER_WORD:
        labels = labels.copy()
    row = labels.reshape(-1)
    words = row[: row.size // LABELS_PER_WORD * LABELS_PER_WORD].view(np.uint64)
    nx, ny, nz = (int(size) for size in labels.shape)
    cells = tuple(max(size - 1, 0) for size in nodes.shape[:3])
    empty = np.zeros(cells, np.bool_)
    voxels = Voxels(row, words, nx, ny, nz, channel_of_label.astype(np.uint64), empty)
    find_empty_cells(nodes, voxels, channels, empty)
    return voxels

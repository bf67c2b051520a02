"""Kernels on label volumes: runs of tissue and the bodies they join into."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel


@kernel
def count_runs(labels: NDArray[np.uint8]) -> int:
    """Number of unbroken runs of tissue along z in labels [x, y, z]."""
    nx, ny, nz = labels.shape
    runs = 0
    for i in range(nx):
        for j in range(ny):
            inside = False
            for k in range(nz):
                tissue = labels[i, j, k] != 0
                if tissue and not inside:
                    runs += 1
                inside = tissue
    return runs


@kernel
def find_runs(
    labels: NDArray[np.uint8], out_span: NDArray[np.int32], out_first: NDArray[np.int64]
) -> None:
    """Fill the first and last z of each run, and the number of the first run of each column.

    `out_span` is (runs, 2), `out_first` is (nx * ny + 1,).
    """
    nx, ny, nz = labels.shape
    run = 0
    for i in range(nx):
        for j in range(ny):
            out_first[i * ny + j] = run
            inside = False
            for k in range(nz):
                tissue = labels[i, j, k] != 0
                if tissue and not inside:
                    out_span[run, 0] = k
                if tissue:
                    out_span[run if not inside else run - 1, 1] = k
                if tissue and not inside:
                    run += 1
                inside = tissue
    out_first[nx * ny] = run


@kernel
def _root(parent: NDArray[np.int64], run: int) -> int:
    while parent[run] != run:
        parent[run] = parent[parent[run]]
        run = parent[run]
    return run


@kernel
def join_runs(
    span: NDArray[np.int32], first: NDArray[np.int64], nx: int, ny: int, out_body: NDArray[np.int64]
) -> None:
    """Give each run the number of the first run of its body.

    Voxels are neighbours by face, so two runs of columns side by side touch where spans overlap.
    """
    for run in range(span.shape[0]):
        out_body[run] = run
    for i in range(nx):
        for j in range(ny):
            for back in range(2):  # the columns before this one along x and along y
                p, q = i - 1 + back, j - back
                if p < 0 or q < 0:
                    continue
                a, b = first[i * ny + j], first[p * ny + q]
                a_end, b_end = first[i * ny + j + 1], first[p * ny + q + 1]
                while a < a_end and b < b_end:
                    if span[a, 0] <= span[b, 1] and span[b, 0] <= span[a, 1]:
                        low, high = _root(out_body, a), _root(out_body, b)
                        if low > high:
                            low, high = high, low
                        out_body[high] = low
                    if span[a, 1] < span[b, 1]:
                        a += 1
                    else:
                        b += 1
    for run in range(span.shape[0]):
        out_body[run] = _root(out_body, run)

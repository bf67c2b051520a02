"""The detector that photons are scored on: its response by energy and angle, and its grid."""

from __future__ import annotations

from typing import NamedTuple

from mammosim._jit import borrowing_kernel
from mammosim.acquisition.monte_carlo._flight_kernels import DETECTED, F32, F64, Ray


class Turn(NamedTuple):
    """From the gantry's frame to the detector's: x stays, ``v = cosine y - sine z + y_mm`` and
    ``w = sine y + cosine z + z_mm``; there the detector lies flat."""

    cosine: float
    sine: float
    y_mm: float
    z_mm: float


class Screen(NamedTuple):
    """Where scatter is scored: cells in the image's order on the detector's plane.

    All in the detector's frame, to which `turn` leads: a photon at x, v is in row
    ``row_0 + row_y v`` and column ``column_0 + column_x x``.
    `response` [energy, cosine] is the part of its energy that is recorded, `grid` [energy, cosine,
    tangent] the grid's transmission; its strips run along x if `along_x` else along y, and are
    focused on `spot`.
    """

    z: float
    row_0: float
    row_y: float
    column_0: float
    column_x: float
    response: F32
    grid: F32
    largest_tangent: float
    along_x: bool
    spot: F64
    turn: Turn


@borrowing_kernel
def score_at_screen(
    screen: Screen,
    kev: float,
    ray: Ray,
    weight: float,
    energy: int,
    out_scatter: F64,
    ledger: F64,
) -> None:
    """Add a photon that leaves the scene downwards to the cell of the detector that it meets."""
    x, y, z, dx, dy, dz = ray
    turn = screen.turn
    y, z = turn.cosine * y - turn.sine * z + turn.y_mm, turn.sine * y + turn.cosine * z + turn.z_mm
    dy, dz = turn.cosine * dy - turn.sine * dz, turn.sine * dy + turn.cosine * dz
    if dz >= 0.0:
        return
    down = (screen.z - z) / dz
    x += down * dx
    y += down * dy
    row, column = screen.row_0 + screen.row_y * y, screen.column_0 + screen.column_x * x
    _, rows, columns = out_scatter.shape
    if not (0.0 <= row < rows and 0.0 <= column < columns):
        return
    ledger[DETECTED] += weight * kev
    at = min(int(-dz * screen.response.shape[1]), screen.response.shape[1] - 1)
    recorded = weight * kev * screen.response[energy, at]
    out_scatter[0, int(row), int(column)] += recorded
    if screen.grid.shape[0] > 1:
        height = screen.spot[2] - screen.z
        if screen.along_x:
            tangent = abs(dy / -dz - (y - screen.spot[1]) / height)
        else:
            tangent = abs(dx / -dz - (x - screen.spot[0]) / height)
        last = screen.grid.shape[2] - 1
        near = min(int(tangent / screen.largest_tangent * last), last)
        at = min(int(-dz * screen.grid.shape[1]), screen.grid.shape[1] - 1)
        out_scatter[1, int(row), int(column)] += recorded * screen.grid[energy, at, near]

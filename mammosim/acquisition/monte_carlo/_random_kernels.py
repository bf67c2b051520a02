"""Random numbers that depend on nothing but a key and a count: one stream a photon.

Philox 4x32 with 10 rounds: Salmon, Moraes, Dror & Shaw 2011, "Parallel random numbers: as easy as
1, 2, 3", SC '11. The constants are those of its section 4.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mammosim._jit import inlined_kernel

_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
_TO_UNIT = 1.0 / 4294967296.0
_ROUNDS = 10
"""Multipliers, Weyl constants and rounds of Philox 4x32-10 (Salmon et al. 2011)."""


class Stream(NamedTuple):
    """A photon's own stream: two words of key, and its number as two words of the counter."""

    key_0: np.uint64
    key_1: np.uint64
    low: np.uint64
    high: np.uint64


Quadruple = tuple[float, float, float, float]


@inlined_kernel
def philox(stream: Stream, block: np.uint64) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Four words of 32 random bits: the `block`-th of a stream."""
    a, b, c, d = block, np.uint64(0), stream.low, stream.high
    key_0, key_1 = stream.key_0, stream.key_1
    for _ in range(_ROUNDS):
        first = _MULTIPLIER_0 * a
        second = _MULTIPLIER_1 * c
        a, b, c, d = (
            (second >> _HALF) ^ b ^ key_0, second & _LOW,
            (first >> _HALF) ^ d ^ key_1, first & _LOW,
        )  # fmt: skip
        key_0 = (key_0 + _WEYL_0) & _LOW
        key_1 = (key_1 + _WEYL_1) & _LOW
    return a, b, c, d


@inlined_kernel
def uniforms(stream: Stream, block: int) -> Quadruple:
    """Four numbers between 0 and 1, neither included."""
    a, b, c, d = philox(stream, np.uint64(block))
    return (a + 0.5) * _TO_UNIT, (b + 0.5) * _TO_UNIT, (c + 0.5) * _TO_UNIT, (d + 0.5) * _TO_UNIT

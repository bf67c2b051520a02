"""Formulas of springs that stiffen as they are strained, E = Ec exp(Enl e), and their kernels."""

import numpy as np

from mammosim._jit import inlined_kernel

LARGEST_STRAIN = 0.6
"""Strain from which on a spring stiffens no further, so that its modulus stays finite: that of fat
is then 90 times, that of an abnormality 160 000 times the one at rest. Assumed."""


@inlined_kernel
def spring_strain(rx, ry, rz, dx, dy, dz):
    """Strain |L / L0 - 1| of a spring that reaches over r and is at rest over D, then L and L0."""
    length = np.sqrt(rx * rx + ry * ry + rz * rz)
    at_rest = np.sqrt(dx * dx + dy * dy + dz * dz)
    return abs(length / at_rest - 1.0), length, at_rest


@inlined_kernel
def stiffened(own, own_growth, other, other_growth, strain):
    """Stiffness of a spring, the smaller of its two nodes' E(e), and the growth of that node.

    The growth is 0 beyond the largest strain.
    """
    e = min(strain, LARGEST_STRAIN)
    if own <= other and own_growth <= other_growth:
        stiffness, growth = own * np.exp(own_growth * e), own_growth
    elif own >= other and own_growth >= other_growth:
        stiffness, growth = other * np.exp(other_growth * e), other_growth
    else:
        here, there = own * np.exp(own_growth * e), other * np.exp(other_growth * e)
        stiffness, growth = min(here, there), own_growth if here <= there else other_growth
    return stiffness, growth if strain < LARGEST_STRAIN else 0.0

"""What a tissue law is: the energy of a change of shape at a point, and its derivatives.

A law is an energy of I1, the sum of the squares of the deformation gradient F, and J, its
determinant; C is the cofactor of F, the derivative of J by F. It is a NamedTuple of numbers, the
first `least_volume`, of one class for each law. Each law has a `_..._kernels.py` of its own with
its class and its two formulas, and a line in the table `LAWS`. What keeps the volume is no part of
it: that is the element's (`_element_kernels`).
"""

import numpy as np

from mammosim._jit import chosen_by_type, inlined_kernel

_SEED = np.int32(0x548C39CB)
"""Bits of the single-precision seed of 1 / cbrt(x): exponent and mantissa divided by minus 3."""


@chosen_by_type
def law_stress(law, modulus, invariant, volume):
    """Energy of a law W at a point, and its first derivatives, in double precision.

    Parameters
    ----------
    law : NamedTuple
    modulus : float
        Shear modulus at rest times the point's weight.
    invariant, volume : float
        I1 and J.

    Returns
    -------
    energy : float
        W.
    along_f, along_c : float
        2 dW/dI1 and dW/dJ: the stress is ``along_f F + along_c C``.
    """
    raise NotImplementedError


@chosen_by_type
def law_curvature(law, modulus, invariant, volume):
    """Second derivatives of a law W at a point, in single precision.

    The second derivative by F is ``scale dF:dF + cc (C:dF)^2 - 2 cf (C:dF)(F:dF) + ff (F:dF)^2 +
    along_c dF:dC``, of which all but the last term must be positive definite: a law bounds them so.

    Parameters
    ----------
    law, modulus, invariant, volume
        As `law_stress` takes them.

    Returns
    -------
    scale, along_c, cc, cf : float32
        2 dW/dI1, dW/dJ, d2W/dJ2 and -2 d2W/dI1dJ.
    ff : float32 or None
        4 d2W/dI1^2; None where it is 0 for all.
    """
    raise NotImplementedError


@inlined_kernel
def inverse_cube_root(x):
    """x^(-1/3) for x > 0 by four Newton steps from a bitwise seed good to 4 %; to 1e-9."""
    bits = np.int32(_SEED - np.float32(x).view(np.int32) // np.int32(3))
    y = np.float64(bits.view(np.float32))
    y = y * (4.0 - x * y * y * y) * (1.0 / 3.0)
    y = y * (4.0 - x * y * y * y) * (1.0 / 3.0)
    y = y * (4.0 - x * y * y * y) * (1.0 / 3.0)
    return y * (4.0 - x * y * y * y) * (1.0 / 3.0)


@inlined_kernel
def volume_factor(volume, least):
    """phi = J^(-2/3) and its first two derivatives, continued by its parabola below J = `least`.

    The parabola keeps the energy finite, and its slope unfolding, where an element is inverted on
    the way to the solution.
    """
    bounded = max(volume, least)
    root = inverse_cube_root(bounded)
    inverse = 1.0 / bounded
    value = root * root
    slope = -(2.0 / 3.0) * value * inverse
    curvature = -(5.0 / 3.0) * slope * inverse
    below = volume - bounded
    return (
        value + below * (slope + 0.5 * below * curvature),
        slope + below * curvature,
        curvature,
    )

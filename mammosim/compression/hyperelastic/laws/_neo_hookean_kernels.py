"""The neo-Hookean law, ``W = mu/2 (J^(-2/3) I1 - 3)``."""

from typing import NamedTuple

import numpy as np

from mammosim.compression.hyperelastic.laws._law_kernels import (
    law_curvature,
    law_stress,
    volume_factor,
)


class NeoHookean(NamedTuple):
    """The law's parameters: J below which it is continued by its parabola."""

    least_volume: float


@law_stress.of(NeoHookean)
def neo_hookean_stress(law, modulus, invariant, volume):
    """Energy and first derivatives: see `law_stress`."""
    factor, slope, _ = volume_factor(volume, law.least_volume)
    energy = 0.5 * modulus * (factor * invariant - 3.0)
    return energy, modulus * factor, 0.5 * modulus * invariant * slope


@law_curvature.of(NeoHookean)
def neo_hookean_curvature(law, modulus, invariant, volume):
    """Second derivatives: see `law_curvature`.

    With phi'^2 <= phi phi''/2, which phi = J^(-2/3) satisfies and to which phi' is bounded where
    the parabola continues it, all but the last term is positive definite.
    """
    half = np.float32(0.5)
    factor, slope, curvature = volume_factor(volume, law.least_volume)
    bounded = min(np.float32(-slope), np.float32(np.sqrt(0.5 * factor * curvature)))
    return (
        modulus * np.float32(factor),
        half * modulus * invariant * np.float32(slope),
        half * modulus * invariant * np.float32(curvature),
        modulus * bounded,
        None,
    )

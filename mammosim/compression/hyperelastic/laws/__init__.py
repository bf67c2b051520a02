"""Laws of tissue: how much energy a change of shape takes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mammosim.compression.hyperelastic.laws._neo_hookean_kernels import NeoHookean

LAWS: dict[str, Callable[[float], Any]] = {"neo_hookean": NeoHookean}
"""Laws by name: each gives, for a least volume, the NamedTuple whose class has the formulas
`law_stress` and `law_curvature`."""

__all__ = ["LAWS", "NeoHookean"]

"""The tissues of the table, and the modulus of each in a named stiffness set."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from ruamel.yaml import YAML

from mammosim.errors import InputError


@dataclass(frozen=True)
class Tissue:
    """One tissue of the table.

    Parameters
    ----------
    name : str
    label : int
        Value in voxel arrays.
    material : str or None
        What it attenuates as; None for air.
    like : str or None
        Tissue whose modulus it takes in a stiffness set that does not name it.
    stiffness_kpa : mapping of str to float
        Young's modulus in each set that names it, kPa.
    stiffening : float or None
        Enl of E = Ec exp(Enl e) at strain e; None: that of the tissue it is `like`.
    mixture : mapping of str to float
        Tissues that share a voxel of it and the part that each fills; they sum to one. Empty for
        all but mixtures, which have no material and no modulus of their own.
    """

    name: str
    label: int
    material: str | None = None
    like: str | None = None
    stiffness_kpa: MappingProxyType[str, float] = field(
        default_factory=lambda: MappingProxyType({})
    )
    stiffening: float | None = None
    mixture: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))


def _load() -> dict[str, Any]:
    text = files(__package__).joinpath("tissues.yaml").read_text(encoding="utf-8")
    loaded: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
    return loaded


_TABLE = _load()

TISSUES: MappingProxyType[str, Tissue] = MappingProxyType(
    {
        name: Tissue(
            name,
            block["label"],
            block.get("material"),
            block.get("like"),
            MappingProxyType(block.get("stiffness_kpa", {})),
            block.get("stiffening"),
            MappingProxyType(block.get("mixture", {})),
        )
        for name, block in _TABLE["tissues"].items()
    }
)
"""Every tissue by name."""

STIFFNESS_SETS: tuple[str, ...] = tuple(
    sorted({name for tissue in TISSUES.values() for name in tissue.stiffness_kpa})
)
"""Names of the stiffness sets."""

_POISSON_RATIO: dict[str, float] = _TABLE["poisson_ratio"]

LESION_LABELS: tuple[int, ...] = tuple(
    label for label in range(151, 256) if label not in {tissue.label for tissue in TISSUES.values()}
)
"""Labels free for single lesions, so that each keeps its own image and its own mask."""


def stiffness_kpa(tissue: str, stiffness_set: str) -> float:
    """Young's modulus of a tissue in a stiffness set, kPa.

    Parameters
    ----------
    tissue : str
        Name of a tissue other than air.
    stiffness_set : str
        One of `STIFFNESS_SETS`.

    Raises
    ------
    InputError
        If the set does not exist.

    Examples
    --------
    >>> stiffness_kpa("duct", "thesis")
    15.0
    """
    if stiffness_set not in STIFFNESS_SETS:
        raise InputError(
            f"compression.stiffness: found '{stiffness_set}', "
            f"expected one of {', '.join(STIFFNESS_SETS)}"
        )
    entry = TISSUES[tissue]
    if entry.mixture:
        return _mean(entry.mixture, lambda part: stiffness_kpa(part, stiffness_set))
    while stiffness_set not in entry.stiffness_kpa:
        if entry.like is None:
            raise InputError(f"tissue '{entry.name}' has no stiffness in set '{stiffness_set}'")
        entry = TISSUES[entry.like]
    return entry.stiffness_kpa[stiffness_set]


SKIN_THICKNESS_MM: float = _TABLE["skin_thickness_mm"]
"""Of breast skin where a phantom does not show it."""

SKIN_SHEETS: MappingProxyType[str, float] = MappingProxyType(_TABLE["skin_sheet_kpa"])
"""Young's modulus, kPa, of skin as a thin sheet, in each stiffness set that has it so."""

SKIN_STIFFENING: MappingProxyType[str, float] = MappingProxyType(_TABLE["skin_sheet_stiffening"])
"""How skin as a thin sheet stiffens with stretch, in each stiffness set in which it does."""


@dataclass(frozen=True)
class SkinSheet:
    """Skin as a thin sheet around the breast.

    Parameters
    ----------
    young_kpa : float
        Young's modulus, kPa.
    thickness_mm : float or None
        None: as the phantom shows it, else `SKIN_THICKNESS_MM`.
    stiffening : float
        b of the energy ``young_kpa / 6 (I + b I^2 / 2)``, I being that of the neo-Hookean law.
    """

    young_kpa: float
    thickness_mm: float | None = None
    stiffening: float = 0.0


@dataclass(frozen=True)
class Moduli:
    """Young's modulus of every tissue: a stiffness set, and what is given in its place.

    Parameters
    ----------
    stiffness_set : str
        One of `STIFFNESS_SETS`.
    given : mapping of str to float
        Modulus of single tissues, kPa; those that take it over in the table (`like`) follow, but
        for tissues that the set names.

    Examples
    --------
    >>> moduli = Moduli("victre", {"mass": 100.0})
    >>> moduli("mass"), moduli("calcification"), moduli("gland")
    (100.0, 100.0, 15.0)
    """

    stiffness_set: str
    given: Mapping[str, float] = field(default_factory=dict)

    def __call__(self, tissue: str) -> float:
        """Young's modulus of a tissue other than air, kPa."""
        entry = TISSUES[tissue]
        if entry.mixture and tissue not in self.given:
            return _mean(entry.mixture, self)
        while entry.name not in self.given:
            if self.stiffness_set in entry.stiffness_kpa or entry.like is None:
                return stiffness_kpa(tissue, self.stiffness_set)
            entry = TISSUES[entry.like]
        return self.given[entry.name]


def stiffening(tissue: str) -> float:
    """How fast a tissue stiffens: Enl of E = Ec exp(Enl e) at strain e.

    Parameters
    ----------
    tissue : str
        Name of a tissue other than air.

    Notes
    -----
    One value a tissue, from the listing of the thesis; a stiffness set chooses only Ec.

    Examples
    --------
    >>> stiffening("duct")
    10.0
    """
    entry = TISSUES[tissue]
    if entry.mixture:
        return _mean(entry.mixture, stiffening)
    while entry.stiffening is None:
        entry = TISSUES[str(entry.like)]
    return entry.stiffening


def _mean(mixture: Mapping[str, float], value_of: Callable[[str], float]) -> float:
    """Mean over a mixture's tissues, of a modulus an upper bound (Voigt 1889, Ann Phys 274:573)."""
    return sum(part * value_of(tissue) for tissue, part in mixture.items())


def poisson_ratio(stiffness_set: str) -> float:
    """Poisson's ratio of every tissue in a stiffness set.

    Parameters
    ----------
    stiffness_set : str
        One of `STIFFNESS_SETS`.

    Examples
    --------
    >>> poisson_ratio("victre")
    0.49
    """
    return _POISSON_RATIO[stiffness_set]

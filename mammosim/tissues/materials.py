"""What materials are made of: named composition sets, and sets from a user's file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from ruamel.yaml import YAML

from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.tissues.table import TISSUES


@dataclass(frozen=True)
class Material:
    """Density and elements of one material.

    Parameters
    ----------
    name : str
    density_g_cm3 : float
    mass_fraction : mapping of str to float
        Share of each element by mass, by symbol; they sum to one.
    source : str
        Where the numbers come from.
    """

    name: str
    density_g_cm3: float
    mass_fraction: Mapping[str, float]
    source: str


def _load() -> dict[str, Any]:
    text = files(__package__).joinpath("materials.yaml").read_text(encoding="utf-8")
    loaded: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
    return loaded


_TABLE = _load()

COMPOSITION_SETS: tuple[str, ...] = tuple(_TABLE["sets"])
"""Names of the composition sets."""

CALCIFICATIONS: tuple[str, ...] = tuple(_TABLE["calcifications"])
"""Names of the materials that a calcification may be made of."""

MATERIAL_NAMES: tuple[str, ...] = tuple(
    dict.fromkeys(tissue.material for tissue in TISSUES.values() if tissue.material)
)
"""Every material that the tissue table names."""


FOREIGN_MATERIALS: tuple[str, ...] = (
    "titanium", "silicone", "saline", "pmma", "water", "iodinated water", "lung"
)  # fmt: skip
"""Materials that are no part of the breast, for its volume, density and glandularity."""


def composition(name_or_path: str, calcification: str) -> MappingProxyType[str, Material]:
    """Every material of the tissue table in one composition set.

    Parameters
    ----------
    name_or_path : str
        One of `COMPOSITION_SETS`, or the path of a YAML file with blocks as in
        ``materials.yaml``: ``material: {density_g_cm3, mass_percent, source}``. What the file
        does not name is taken from ``hammerstein``.
    calcification : str
        One of `CALCIFICATIONS`.

    Returns
    -------
    mapping of str to Material

    Raises
    ------
    InputError
        If there is no such set, file or calcification, or a block of the file cannot be used.

    Examples
    --------
    >>> composition("hammerstein", "oxalate")["gland"].density_g_cm3
    1.04
    """
    if calcification not in CALCIFICATIONS:
        raise InputError(
            f"acquisition.calcification: found '{calcification}', "
            f"expected one of {', '.join(CALCIFICATIONS)}"
        )
    blocks = {"calcification": _TABLE["calcifications"][calcification], **_TABLE["shared"]}
    blocks |= _set_blocks(name_or_path)
    for name, block in list(blocks.items()):
        if "like" in block:
            blocks[name] = {**blocks[block["like"]], **block}
    return MappingProxyType({name: _material(name, blocks[name]) for name in MATERIAL_NAMES})


def density_g_cm3(tissue: str) -> float:
    """Density of a tissue, g/cm3: that of its material in the set ``hammerstein``.

    Parameters
    ----------
    tissue : str
        Name of a tissue other than air.

    Examples
    --------
    >>> density_g_cm3("adipose")
    0.93
    """
    mixture = TISSUES[tissue].mixture
    if mixture:
        return sum(part * density_g_cm3(name) for name, part in mixture.items())
    material = TISSUES[tissue].material
    return composition("hammerstein", CALCIFICATIONS[0])[str(material)].density_g_cm3


def _set_blocks(name_or_path: str) -> dict[str, Any]:
    if name_or_path in _TABLE["sets"]:
        return dict(_TABLE["sets"][name_or_path])
    if not str(name_or_path).endswith((".yaml", ".yml")):
        raise InputError(
            f"acquisition.composition: found '{name_or_path}', expected one of "
            f"{', '.join(COMPOSITION_SETS)} or the path of a .yaml file"
        )
    blocks = read_yaml(name_or_path)
    problems = _problems(blocks, str(name_or_path))
    if problems:
        raise InputError(problems)
    return {**_TABLE["sets"]["hammerstein"], **blocks}


def _problems(blocks: Any, where: str) -> list[str]:
    if not isinstance(blocks, dict) or not blocks:
        return [f"{where}: expected blocks of 'material: {{density_g_cm3, mass_percent, source}}'"]
    problems = []
    for name, block in blocks.items():
        if name not in MATERIAL_NAMES:
            problems.append(
                f"{where}: unknown material '{name}', expected one of {', '.join(MATERIAL_NAMES)}"
            )
        elif not isinstance(block, dict) or not {"density_g_cm3", "mass_percent"} <= set(block):
            problems.append(f"{where}: {name}: expected density_g_cm3 and mass_percent")
        else:
            problems += _number_problems(block, f"{where}: {name}")
    return problems


def _number_problems(block: dict[str, Any], where: str) -> list[str]:
    density, percent = block["density_g_cm3"], block["mass_percent"]
    problems = []
    if not _is_number(density) or not 0.1 <= density <= 25.0:
        problems.append(f"{where}: density_g_cm3: found {density!r}, expected 0.1 to 25 g/cm3")
    if not isinstance(percent, dict) or not all(
        _is_number(value) and value >= 0.0 for value in percent.values()
    ):
        problems.append(f"{where}: mass_percent: found {percent!r}, expected 'element: per cent'")
    elif odd := [element for element in percent if not _is_symbol(element)]:
        problems.append(f"{where}: mass_percent: found the element {odd[0]!r}, expected H, C, ...")
    elif not 98.0 <= sum(percent.values()) <= 102.0:
        problems.append(f"{where}: mass_percent adds up to {sum(percent.values()):g}, expected 100")
    return problems


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_symbol(element: Any) -> bool:
    """Whether a key may be an element's symbol: letters, which xraylib takes."""
    return isinstance(element, str) and element.isascii() and element.isalpha()


def _material(name: str, block: dict[str, Any]) -> Material:
    percent = block["mass_percent"]
    total = sum(percent.values())
    fraction = MappingProxyType({element: value / total for element, value in percent.items()})
    return Material(name, float(block["density_g_cm3"]), fraction, str(block.get("source", "")))

"""Composition of tissues that hold a contrast agent."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.tissues import Material, composition

MG_PER_G = 1000.0


def materials_of(settings: AcquisitionSettings) -> Mapping[str, Material]:
    """Every material of the tissue table, with the iodine that the settings put into it.

    Raises
    ------
    InputError
        As `composition`.
    """
    materials = composition(settings.composition, settings.calcification)
    if settings.contrast is None:
        return materials
    agent = settings.contrast
    uptake = {"mass": agent.lesion_mg_ml, "gland": agent.parenchyma_mg_ml,
              "blood": agent.blood_mg_ml}  # fmt: skip
    iodinated = {name: with_iodine(materials[name], mg_ml) for name, mg_ml in uptake.items()}
    return MappingProxyType({**materials, **iodinated})


def with_iodine(material: Material, mg_ml: float) -> Material:
    """A material with iodine added, which displaces none of its own elements.

    Parameters
    ----------
    material : Material
    mg_ml : float
        Iodine, mg per mL of the material.

    Notes
    -----
    The rest of the agent's molecule is left out: light elements, of which a few mg/mL change the
    attenuation by less than 0.5 per cent.

    Examples
    --------
    >>> water = composition("hammerstein", "oxalate")["water"]
    >>> iodinated = with_iodine(water, 10.0)
    >>> iodinated.density_g_cm3, round(100 * iodinated.mass_fraction["I"], 3)
    (1.01, 0.99)
    """
    if mg_ml == 0.0:
        return material
    added = mg_ml / MG_PER_G
    density = material.density_g_cm3 + added
    fractions = {
        element: part * material.density_g_cm3 / density
        for element, part in material.mass_fraction.items()
    }
    fractions["I"] = fractions.get("I", 0.0) + added / density
    source = f"{material.source}; {mg_ml:g} mg/mL iodine"
    return Material(material.name, density, MappingProxyType(fractions), source)

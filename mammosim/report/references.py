"""What a run should cite: papers behind the models and the software that it used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mammosim.bibliography import works
from mammosim.compression import MODELS


@dataclass(frozen=True)
class Reference:
    """One work to cite.

    Parameters
    ----------
    used_for : str
        What of the run rests on it.
    citation : str
        Authors, title, journal, year.
    doi : str
        Digital object identifier; empty where there is none.
    """

    used_for: str
    citation: str
    doi: str = ""


def _of_work(used_for: str, key: str) -> Reference:
    work = works()[key]
    return Reference(used_for, work.citation, work.doi)


REFERENCES: dict[str, Reference] = {
    "springs": _of_work("spring model of compression", "zyganitidis2007"),
    "wellman": _of_work("stiffness set 'thesis'", "wellman1999"),
    "victre": _of_work("labels, densities and stiffness set 'victre'", "badano2018"),
    "spekpy": _of_work("X-ray spectrum", "bujila2020"),
    "xraylib": _of_work("attenuation coefficients", "schoonjans2011"),
    "hammerstein": _of_work("composition of adipose and glandular tissue", "hammerstein1979"),
    "boone": _of_work("published ranges of scatter and thickness", "boone2000"),
    "dance1990": _of_work("mean glandular dose, factor g", "dance1990"),
    "dance2000": _of_work("mean glandular dose, factors c and s", "dance2000"),
    "dance2009": _of_work("mean glandular dose, factor s for further spectra", "dance2009"),
    "samani": _of_work("spread of tissue stiffness (uncertainty)", "samani2007"),
    "krouskop": _of_work(
        "stiffness set 'krouskop', spread of tissue stiffness (uncertainty)", "krouskop1998"
    ),
    "aspiration": _of_work("stiffness set 'aspiration'", "aspiration"),
    "hauge": _of_work("spread of the compressed thickness (uncertainty)", "hauge2012"),
    "plotly": _of_work("3-D view of the report", "plotly2012"),
    "numba": _of_work("compiled kernels", "lam2015"),
    "dance2011": _of_work("dose of a tube angle over that of the upright tube", "dance2011"),
    "rtk": _of_work("slices of tomosynthesis", "rit2014"),
    "numpy": _of_work("arrays", "harris2020"),
    "scipy": _of_work("numerical algorithms", "virtanen2020"),
    "highdicom": _of_work("DICOM segmentation", "bridge2022"),
    "simpleitk": _of_work("NIfTI volumes", "lowekamp2013"),
}
"""Every reference by its key."""


def references_used(settings: Mapping[str, Any]) -> list[Reference]:
    """References of what a run used.

    Parameters
    ----------
    settings : mapping
        The resolved configuration as plain values, section by section. A key that is not there
        counts as its default.

    Returns
    -------
    list of Reference
        In the order of the stages.
    """
    phantom, compression, acquisition, export = (
        settings.get(name) or {} for name in ("phantom", "compression", "acquisition", "export")
    )
    model = MODELS[compression.get("model", "hyperelastic")]
    stiffness = compression.get("stiffness", model.usual.get("stiffness", "thesis"))
    targets, report = (settings.get(name) or {} for name in ("targets", "report"))
    varied = targets.get("uncertainty") is not None
    views = [view for view in settings.get("views") or () if isinstance(view, Mapping)]
    series = [view["dbt"] for view in views if isinstance(view.get("dbt"), Mapping)]
    used = {
        **{key: key in model.references for one in MODELS.values() for key in one.references},
        "wellman": model.compresses and stiffness == "thesis",
        "victre": "victre" in (phantom.get("labels"), stiffness),
        "spekpy": acquisition.get("spectrum_file") is None,
        "hammerstein": acquisition.get("composition", "hammerstein") == "hammerstein",
        "samani": varied,
        "krouskop": varied or stiffness == "krouskop",
        "aspiration": stiffness == "aspiration",
        "hauge": varied,
        "dance2011": bool(series),
        "rtk": any(one.get("reconstruct") is not None for one in series),
        "plotly": report.get("html", True) and report.get("three_d", True),
        "highdicom": export.get("dicom", True),
        "simpleitk": export.get("volumes", True),
    }
    return [reference for key, reference in REFERENCES.items() if used.get(key, True)]

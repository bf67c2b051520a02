"""What a run should cite: papers behind the models and the software that it used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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


REFERENCES: dict[str, Reference] = {
    "springs": Reference(
        "spring model of compression",
        "Zyganitidis C, Bliznakova K, Pallikarakis N. A novel simulation algorithm for soft tissue "
        "compression. Med Biol Eng Comput 45:661-669, 2007.",
        "10.1007/s11517-007-0205-y",
    ),
    "wellman": Reference(
        "stiffness set 'thesis'",
        "Wellman P, Howe RD, Dalton E, Kern KA. Breast tissue stiffness in compression is "
        "correlated to histological diagnosis. Harvard BioRobotics Laboratory Technical Report, "
        "1999.",
    ),
    "victre": Reference(
        "labels, densities and stiffness set 'victre'",
        "Badano A, Graff CG, Badal A, et al. Evaluation of digital breast tomosynthesis as "
        "replacement of full-field digital mammography using an in silico imaging trial. "
        "JAMA Netw Open 1(7):e185474, 2018.",
        "10.1001/jamanetworkopen.2018.5474",
    ),
    "spekpy": Reference(
        "X-ray spectrum",
        "Bujila R, Omar A, Poludniowski G. A validation of SpekPy: a software toolkit for "
        "modelling X-ray tube spectra. Phys Med 75:44-54, 2020.",
        "10.1016/j.ejmp.2020.04.026",
    ),
    "xraylib": Reference(
        "attenuation coefficients",
        "Schoonjans T, Brunetti A, Golosio B, et al. The xraylib library for X-ray-matter "
        "interactions. Recent developments. Spectrochim Acta B 66:776-784, 2011.",
        "10.1016/j.sab.2011.09.011",
    ),
    "hammerstein": Reference(
        "composition of adipose and glandular tissue",
        "Hammerstein GR, Miller DW, White DR, et al. Absorbed radiation dose in mammography. "
        "Radiology 130:485-491, 1979.",
        "10.1148/130.2.485",
    ),
    "boone": Reference(
        "published ranges of scatter and thickness",
        "Boone JM, Lindfors KK, Cooper VN, Seibert JA. Scatter/primary in mammography: "
        "comprehensive results. Med Phys 27:2408-2416, 2000.",
        "10.1118/1.1312812",
    ),
    "dance1990": Reference(
        "mean glandular dose, factor g",
        "Dance DR. Monte Carlo calculation of conversion factors for the estimation of mean "
        "glandular breast dose. Phys Med Biol 35:1211-1219, 1990.",
        "10.1088/0031-9155/35/9/002",
    ),
    "dance2000": Reference(
        "mean glandular dose, factors c and s",
        "Dance DR, Skinner CL, Young KC, Beckett JR, Kotre CJ. Additional factors for the "
        "estimation of mean glandular breast dose using the UK mammography dosimetry protocol. "
        "Phys Med Biol 45:3225-3240, 2000.",
        "10.1088/0031-9155/45/11/308",
    ),
    "dance2009": Reference(
        "mean glandular dose, factor s for further spectra",
        "Dance DR, Young KC, van Engen RE. Further factors for the estimation of mean glandular "
        "dose using the United Kingdom, European and IAEA breast dosimetry protocols. "
        "Phys Med Biol 54:4361-4372, 2009.",
        "10.1088/0031-9155/54/14/002",
    ),
    "samani": Reference(
        "spread of tissue stiffness (uncertainty)",
        "Samani A, Zubovits J, Plewes D. Elastic moduli of normal and pathological human breast "
        "tissues: an inversion-technique-based investigation of 169 samples. Phys Med Biol "
        "52:1565-1576, 2007.",
        "10.1088/0031-9155/52/6/002",
    ),
    "krouskop": Reference(
        "stiffness set 'krouskop', spread of tissue stiffness (uncertainty)",
        "Krouskop TA, Wheeler TM, Kallel F, Garra BS, Hall T. Elastic moduli of breast and "
        "prostate tissues under compression. Ultrason Imaging 20:260-274, 1998.",
        "10.1177/016173469802000403",
    ),
    "aspiration": Reference(
        "stiffness set 'aspiration'",
        "In vivo measurement of breast tissues stiffness using a light aspiration device. Seven "
        "women: skin 56.3 kPa, fat and gland 3.04 kPa.",
    ),
    "hauge": Reference(
        "spread of the compressed thickness (uncertainty)",
        "Hauge IHR, Hogg P, Szczepura K, Connolly P, McGill G, Mercer C. The readout thickness "
        "versus the measured thickness for a range of screen film mammography and full-field "
        "digital mammography units. Med Phys 39:263-271, 2012.",
        "10.1118/1.3663579",
    ),
    "plotly": Reference(
        "3-D view of the report",
        "Plotly Technologies Inc. Plotly.js, an open-source JavaScript charting library, MIT "
        "licence. Montreal, 2012-2026.",
    ),
    "numba": Reference(
        "compiled kernels",
        "Lam SK, Pitrou A, Seibert S. Numba: a LLVM-based Python JIT compiler. Proc LLVM-HPC, "
        "2015.",
        "10.1145/2833157.2833162",
    ),
    "dance2011": Reference(
        "dose of a tube angle over that of the upright tube",
        "Dance DR, Young KC, van Engen RE. Estimation of mean glandular dose for breast "
        "tomosynthesis: factors for use with the UK, European and IAEA breast dosimetry protocols. "
        "Phys Med Biol 56:453-471, 2011.",
        "10.1088/0031-9155/56/2/011",
    ),
    "rtk": Reference(
        "slices of tomosynthesis",
        "Rit S, Vila Oliva M, Brousmiche S, et al. The Reconstruction Toolkit (RTK), an "
        "open-source cone-beam CT reconstruction toolkit based on the Insight Toolkit (ITK). "
        "J Phys Conf Ser 489:012079, 2014.",
        "10.1088/1742-6596/489/1/012079",
    ),
    "numpy": Reference(
        "arrays",
        "Harris CR, Millman KJ, van der Walt SJ, et al. Array programming with NumPy. "
        "Nature 585:357-362, 2020.",
        "10.1038/s41586-020-2649-2",
    ),
    "scipy": Reference(
        "numerical algorithms",
        "Virtanen P, Gommers R, Oliphant TE, et al. SciPy 1.0: fundamental algorithms for "
        "scientific computing in Python. Nat Methods 17:261-272, 2020.",
        "10.1038/s41592-019-0686-2",
    ),
    "highdicom": Reference(
        "DICOM segmentation",
        "Bridge CP, Gorman C, Pieper S, et al. Highdicom: a Python library for standardized "
        "encoding of image annotations and machine learning model outputs in pathology and "
        "radiology. J Digit Imaging 35:1719-1737, 2022.",
        "10.1007/s10278-022-00683-y",
    ),
    "simpleitk": Reference(
        "NIfTI volumes",
        "Lowekamp BC, Chen DT, Ibanez L, Blezek D. The design of SimpleITK. "
        "Front Neuroinform 7:45, 2013.",
        "10.3389/fninf.2013.00045",
    ),
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
    model = MODELS[compression.get("model", "springs")]
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

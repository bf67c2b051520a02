"""Label maps: what each value of a phantom file stands for."""

from __future__ import annotations

import difflib
from types import MappingProxyType
from typing import Any

from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.tissues.table import _TABLE, TISSUES

LABEL_MAPS: MappingProxyType[str, MappingProxyType[int, str]] = MappingProxyType(
    {name: MappingProxyType(mapping) for name, mapping in _TABLE["label_maps"].items()}
)
"""Label maps that come with mammosim, by name."""


OTHER_NAMES = {
    "fat": "adipose", "fatty": "adipose", "adipose tissue": "adipose", "glandular": "gland",
    "fibroglandular": "gland", "parenchyma": "gland", "dense": "gland", "stroma": "ligament",
    "cooper": "ligament", "coopers ligament": "ligament", "pectoral": "muscle",
    "pectoralis": "muscle", "chest wall": "muscle", "areola": "nipple", "lobule": "tdlu",
    "lobe": "tdlu", "vessel": "artery", "blood vessel": "artery", "tumor": "mass",
    "tumour": "mass", "cancer": "mass", "lesion": "mass", "calc": "calcification",
    "microcalcification": "calcification", "marker": "clip", "background": "air", "outside": "air",
    "paddle": "air", "none": "air", "dermis": "skin",
}  # fmt: skip
"""What others call tissues of the table; only suggested, never taken for it."""

DEFAULT_LABELS = "mammosim"
"""Label map of files that do not say what their values stand for."""


def load_label_map(name_or_path: str) -> MappingProxyType[int, str]:
    """A label map by name, or from a YAML file of `label: tissue` lines.

    Parameters
    ----------
    name_or_path : str
        One of `LABEL_MAPS`, or the path of a YAML file.

    Returns
    -------
    mapping of int to str
        File label to tissue name.

    Raises
    ------
    InputError
        If there is no such map or file, or an entry is not `whole number: tissue`.
    """
    if name_or_path in LABEL_MAPS:
        return LABEL_MAPS[name_or_path]
    if not str(name_or_path).endswith((".yaml", ".yml")):
        raise InputError(
            f"phantom.labels: found '{name_or_path}', expected one of "
            f"{', '.join(LABEL_MAPS)} or the path of a .yaml file"
        )
    return MappingProxyType(_checked(read_yaml(name_or_path), str(name_or_path)))


def nearest_tissue(name: Any) -> str | None:
    """The tissue of the table that a name probably means, or None.

    Examples
    --------
    >>> nearest_tissue("fat"), nearest_tissue("Muscles"), nearest_tissue("implant")
    ('adipose', 'muscle', None)
    """
    plain = str(name).strip().lower().replace("_", " ").replace("-", " ").replace("'", "")
    known = {**OTHER_NAMES, **{tissue: tissue for tissue in TISSUES}}
    near = difflib.get_close_matches(plain, known, n=1, cutoff=0.75)
    return known[near[0]] if near else None


def _suggestion(name: Any) -> str:
    near = nearest_tissue(name)
    return f" (did you mean '{near}'?)" if near else ""


def _checked(entries: Any, where: str) -> dict[int, str]:
    if not isinstance(entries, dict) or not entries:
        raise InputError(f"{where}: expected lines of 'label: tissue'")
    problems = []
    for label, tissue in entries.items():
        if isinstance(label, bool) or not isinstance(label, int):
            problems.append(f"{where}: label {label!r}: expected a whole number")
        if not isinstance(tissue, str) or tissue not in TISSUES:
            problems.append(
                f"{where}: label {label!r}: found {tissue!r:.60}{_suggestion(tissue)}, expected "
                f"one of {', '.join(TISSUES)}"
            )
    if problems:
        raise InputError(problems)
    return dict(entries)

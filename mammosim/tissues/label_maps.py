"""Label maps: what each value of a phantom file stands for."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.tissues.table import _TABLE, TISSUES

LABEL_MAPS: MappingProxyType[str, MappingProxyType[Any, str]] = MappingProxyType(
    {name: MappingProxyType(mapping) for name, mapping in _TABLE["label_maps"].items()}
)
"""Label maps that come with mammosim, by name."""

MAX_DECIMALS = 3
"""Of a value in a label map."""


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


def load_label_map(name_or_path: str) -> MappingProxyType[Any, str]:
    """A label map by name, or from a YAML file of `label: tissue` lines.

    Parameters
    ----------
    name_or_path : str
        One of `LABEL_MAPS`, or the path of a YAML file.

    Returns
    -------
    mapping of int or float to str
        File label to tissue name.

    Raises
    ------
    InputError
        If there is no such map or file, or an entry is not `number: tissue`.
    """
    if name_or_path in LABEL_MAPS:
        return LABEL_MAPS[name_or_path]
    if not str(name_or_path).endswith((".yaml", ".yml")):
        raise InputError(
            f"phantom.labels: found '{name_or_path}', expected one of "
            f"{', '.join(LABEL_MAPS)} or the path of a .yaml file"
        )
    return MappingProxyType(_checked(read_yaml(name_or_path), str(name_or_path)))


def decimals_of(label_map: Mapping[Any, str]) -> int:
    """Decimals that the values of a label map have at most.

    Examples
    --------
    >>> decimals_of({0: "air", 2: "gland"}), decimals_of({1.1: "gland", 2: "adipose"})
    (0, 1)
    """
    for decimals in range(MAX_DECIMALS):
        if all(math.isclose(key * 10**decimals, round(key * 10**decimals)) for key in label_map):
            return decimals
    return MAX_DECIMALS


def in_whole_numbers(label_map: Mapping[Any, str], decimals: int) -> dict[int, str]:
    """A label map whose values are 10 to the `decimals` times what they were.

    Examples
    --------
    >>> in_whole_numbers({-1: "air", 1.1: "gland"}, 1)
    {-10: 'air', 11: 'gland'}
    """
    return {round(key * 10**decimals): tissue for key, tissue in label_map.items()}


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


def _checked(entries: Any, where: str) -> dict[Any, str]:
    if not isinstance(entries, dict) or not entries:
        raise InputError(f"{where}: expected lines of 'label: tissue'")
    problems = []
    for label, tissue in entries.items():
        if not _is_label(label):
            problems.append(
                f"{where}: label {label!r}: expected a number of at most {MAX_DECIMALS} decimals"
            )
        if not isinstance(tissue, str) or tissue not in TISSUES:
            problems.append(
                f"{where}: label {label!r}: found {tissue!r:.60}{_suggestion(tissue)}, expected "
                f"one of {', '.join(TISSUES)}"
            )
    if problems:
        raise InputError(problems)
    return dict(entries)


def _is_label(label: Any) -> bool:
    if isinstance(label, bool) or not isinstance(label, int | float) or not abs(label) < 2**31:
        return False
    scaled = label * 10**MAX_DECIMALS
    return math.isclose(scaled, round(scaled), rel_tol=1e-12)

"""A DICOM object: its attributes and their values, its identity and its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from typing import Any

from pydicom import Dataset
from pydicom.dataset import FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian

from mammosim.export.atomic import whole_file
from mammosim.export.identity import IMPLEMENTATION_UID


def set_attributes(dataset: Dataset, attributes: Mapping[str, Any]) -> None:
    """Set attributes by keyword; those that are None are left out."""
    for keyword, value in attributes.items():
        if value is not None:
            setattr(dataset, keyword, value)


def set_identity(dataset: Dataset, sop_class: str, uid: str) -> None:
    """Set class and UID of an object, and its meta header."""
    dataset.SOPClassUID, dataset.SOPInstanceUID = sop_class, uid
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = sop_class
    meta.MediaStorageSOPInstanceUID = uid
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.ImplementationClassUID = IMPLEMENTATION_UID
    meta.ImplementationVersionName = "MAMMOSIM"
    dataset.file_meta = meta


def save_object(dataset: Dataset, path: str | PathLike[str]) -> None:
    """Write a DICOM object whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with whole_file(path) as part:
        dataset.save_as(part, enforce_file_format=True)


def code_item(value: str, scheme: str, meaning: str) -> Dataset:
    """One item of a code sequence."""
    item = Dataset()
    item.CodeValue, item.CodingSchemeDesignator, item.CodeMeaning = value, scheme, meaning
    return item


def decimal_string(value: float) -> str | None:
    """A number as Decimal String: six digits, at most 16 characters; None if it is not finite.

    Examples
    --------
    >>> decimal_string(1 / 3)
    '0.333333'
    """
    return f"{value:.6g}" if math.isfinite(value) else None


def long_string(text: str) -> str:
    """A text as Long String: one line of 64 bytes, no backslash, which parts values.

    Examples
    --------
    >>> long_string("upper\\\\outer  quadrant")
    'upper/outer quadrant'
    """
    line = " ".join(text.replace("\\", "/").split())
    return line.encode("utf-8")[:64].decode("utf-8", errors="ignore")

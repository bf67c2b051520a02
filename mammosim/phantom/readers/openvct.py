"""OpenVCT's `.vctx`: a zip archive of the voxels and of what each of their values stands for.

`NAME/Phantom.dat` holds one byte a voxel, x fastest, then y, then z; `NAME/Phantom.xml` their
number and size, the side, and in `Index_Table` the materials of each value. Facts on the format
are from the University of Pennsylvania's public code (bbarufaldi/OpenVCT_Pipeline: SavePhantom.cpp,
recursive_partition_simulation.cpp, VCT_VoxelArray.h, VCT_IndexTable.h): x runs from the chest wall
to the nipple, z from below (semi-axis c'') to above (c'), y is centred on the nipple; no position
is stored. Of y it is not said which way it runs: it is taken as towards the patient's left, which
makes the axes right-handed.
"""

from __future__ import annotations

import zipfile
import zlib
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import BREAST_AXES
from mammosim.phantom.readers.inflate import read_layers
from mammosim.phantom.readers.plain_xml import parse_xml
from mammosim.phantom.readers.volume import (
    MAX_DEFLATE_RATIO,
    VoxelFile,
    Voxels,
    check_promise,
    checked_shape,
    checked_spacing,
    reason_of,
)

MAX_XML_BYTES = 1 << 24
"""Descriptions take some kilobytes."""

MAX_MEMBERS = 10_000
"""Archives hold two files and some private ones."""

VOXEL_TYPES = {"V_INT8", "V_UINT8", "INT8", "UINT8", "1", "2"}
"""One byte a voxel. OpenVCT's own generator writes unsigned bytes and calls them V_INT8."""

TISSUE_OF_MATERIAL = {
    "air": "air", "adipose": "adipose", "fat": "adipose", "glandular": "gland", "gland": "gland",
    "water": "gland", "skin": "skin", "nipple": "nipple", "muscle": "muscle",
    "ligament": "ligament", "cooper": "ligament", "calcium": "calcification",
    "calcification": "calcification", "mass": "mass", "lesion": "mass",
}  # fmt: skip
"""Tissue of each material of an Index_Table, names in small letters. Water stands for part of the
gland in OpenVCT's mixtures."""

DAMAGE = (
    zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError, KeyError,
    ValueError,
)  # fmt: skip
"""What zipfile raises on archives that are damaged, encrypted or of an unknown compression."""


def open_openvct(path: Path) -> VoxelFile:
    """Read the description of an OpenVCT phantom; nothing is unpacked to disk.

    Raises
    ------
    InputError
        If it is no such archive, a part is missing or there twice, or the voxels do not match.

    Notes
    -----
    A value that mixes materials counts as the one of greatest weight, of equal weights as the
    densest; this is noted. The breast's chest wall is put at x = 0, y and z about the middle.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            data = _member(archive, "Phantom.dat", path)
            description = _member(archive, "Phantom.xml", path)
            check_promise(description.file_size, description.compress_size, MAX_DEFLATE_RATIO, path)
            with archive.open(description) as stream:
                text = stream.read(MAX_XML_BYTES + 1)
    except DAMAGE as error:
        raise InputError(f"{path}: not a whole OpenVCT archive ({reason_of(error)})") from None
    if len(text) > MAX_XML_BYTES:
        raise InputError(f"{path}: its Phantom.xml is longer than {MAX_XML_BYTES} bytes")
    root = _parsed(text, path)
    shape = checked_shape([_whole(root, f"Voxel_Array/VOXEL_NUM/{a}", path) for a in "XYZ"], path)
    sizes = [_number(root, f"Voxel_Array/VOXEL_SIZE_MM/{axis}", path) for axis in "XYZ"]
    spacing = checked_spacing(sizes, path)
    _check_coding(root, path)
    promised = shape[0] * shape[1] * shape[2]
    # zipfile counts on `file_size` alone: both must agree before anything is read.
    if data.file_size != promised:
        raise InputError(
            f"{path}: {data.filename} holds {data.file_size} bytes of voxels, expected {promised} "
            "from Phantom.xml"
        )
    held = min(data.compress_size, path.stat().st_size)
    check_promise(promised, held, MAX_DEFLATE_RATIO, path)
    label_map, notes = _label_map(root, path)
    deformed = root.findtext("Deformation/Deformation_Mode")
    if deformed:
        notes = (
            *notes,
            f"{path.name} is already compressed ({deformed}): use model 'none'",
        )
    half = -0.5 * (np.array(shape) - 1.0) * spacing
    first = np.array([0.5 * spacing[0], half[1], half[2]])
    return VoxelFile(
        path, shape, spacing, np.dtype(np.uint8), partial(_load, path, data.filename, shape),
        BREAST_AXES, "by OpenVCT's generator, but for y", True, first, laterality=_side(root),
        label_map=label_map, notes=notes, files=(path,),
    )  # fmt: skip


def _member(archive: zipfile.ZipFile, name: str, path: Path) -> zipfile.ZipInfo:
    """The one entry of that name, in whatever folder; it is read in place, never extracted."""
    entries = archive.infolist()
    if len(entries) > MAX_MEMBERS:
        raise InputError(f"{path}: holds {len(entries)} entries, expected an OpenVCT archive")
    matching = [entry for entry in entries if entry.filename.rsplit("/", 1)[-1] == name]
    if len(matching) != 1:
        found = ", ".join(entry.filename for entry in entries[:5]) or "nothing"
        raise InputError(
            f"{path}: holds {len(matching)} entries {name} among {found}, expected one"
        )
    return matching[0]


def _parsed(text: bytes, path: Path) -> Element:
    try:
        return parse_xml(text.decode("utf-8"))
    except (ParseError, UnicodeDecodeError, ValueError, LookupError) as error:
        raise InputError(f"{path}: its Phantom.xml cannot be read ({reason_of(error)})") from None


def _text(root: Element, place: str, path: Path) -> str:
    found = root.findtext(place)
    if found is None:
        raise InputError(f"{path}: Phantom.xml has no {place}")
    return found.strip()


def _number(root: Element, place: str, path: Path) -> float:
    text = _text(root, place, path)
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{path}: {place} is '{text}', expected a number") from None


def _whole(root: Element, place: str, path: Path) -> int:
    text = _text(root, place, path)
    if not (text.isascii() and text.isdigit()) or len(text) > 18:
        raise InputError(f"{path}: {place} is '{text}', expected a whole number")
    return int(text)


def _check_coding(root: Element, path: Path) -> None:
    """One byte a voxel, x fastest; fields that are missing count as that."""
    problems = []
    bits = root.findtext("Voxel_Array/Number_Bits", "8").strip()
    kind = root.findtext("Voxel_Array/VOXEL_TYPE", "V_UINT8").strip().upper()
    if bits != "8" or kind not in VOXEL_TYPES:
        problems.append(
            f"{path}: its voxels are {kind} of {bits} bits, expected one byte per voxel"
        )
    order = root.findtext("Voxel_Array/VOXEL_ARRAY_ORDER", "X | Y | Z")
    letters = [letter for letter in order.upper() if letter in "XYZ"]
    if letters != ["X", "Y", "Z"]:
        problems.append(f"{path}: VOXEL_ARRAY_ORDER is '{order.strip()}', expected 'X | Y | Z'")
    if problems:
        raise InputError(problems)


def _label_map(root: Element, path: Path) -> tuple[dict[int, str], tuple[str, ...]]:
    """Tissue of each value by the archive's Index_Table, and which of them are mixtures."""
    tissues: dict[int, str] = {}
    problems, mixed = [], []
    for entry in root.findall("Index_Table/Index"):
        index = _whole(entry, "Index_ID", path)
        materials = [_material(item, path) for item in entry.findall("Materials/Material")]
        if not materials:
            raise InputError(f"{path}: Index_Table: index {index} has no material")
        _, _, name = max(materials)
        if name.lower() not in TISSUE_OF_MATERIAL:
            problems.append(
                f"{path}: Index_Table: index {index} is '{name}', expected one of "
                f"{', '.join(TISSUE_OF_MATERIAL)}; give a label map (phantom.labels)"
            )
        elif tissues.setdefault(index, TISSUE_OF_MATERIAL[name.lower()]) and len(materials) > 1:
            mixed.append(f"{index} as {tissues[index]}")
    if problems:
        raise InputError(problems)
    if not tissues:
        raise InputError(f"{path}: Phantom.xml has no Index_Table that says what each value is")
    if not mixed:
        return tissues, ()
    return tissues, (
        f"{path.name} mixes materials in some values; the one with the greatest weight was used: "
        f"index "
        f"{', '.join(mixed)}",
    )


def _material(item: Element, path: Path) -> tuple[float, float, str]:
    """Weight, density and name."""
    weight = _number(item, "Material_Weight", path)
    density = _number(item, "Material_Density", path)
    if not (np.isfinite(weight) and np.isfinite(density)):
        raise InputError(f"{path}: Index_Table holds a weight or density that is not finite")
    return weight, density, _text(item, "Material_Name", path)


def _side(root: Element) -> str | None:
    return {"LEFT": "L", "RIGHT": "R"}.get(root.findtext("Laterality", "").strip().upper())


def _load(path: Path, name: str, shape: tuple[int, int, int], step: int) -> Voxels:
    try:
        with zipfile.ZipFile(path) as archive, archive.open(name) as stream:
            voxels: Any = stream
            return read_layers(voxels, shape, np.dtype(np.uint8), step, path, "Phantom.xml")
    except DAMAGE as error:
        raise InputError(f"{path}: not a whole OpenVCT archive ({reason_of(error)})") from None

"""Small labelled volumes in every format, for the tests of readers and writers."""

from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pydicom
import SimpleITK as sitk
import tifffile
from pydicom.dataset import FileMetaDataset

from mammosim.phantom.readers import READERS
from mammosim.phantom.readers.axes import AXIS_OF_LETTER, BREAST_FROM_LPS

SERIES = "series"
"""Stands for the folder of a DICOM series among the endings."""

FORMATS = [*READERS, SERIES]

OWN_CODES = (".bin", ".txt")
"""Formats with labels of their own, which cannot hold the small breast's."""

SPACING, ORIGIN = np.array([0.5, 0.75, 1.0]), np.array([3.0, -20.0, 12.5])

LABELS = "0: air\n1: adipose\n29: gland\n33: nipple\n88: ligament\n"


def small_breast() -> np.ndarray:
    """Uneven in every axis, so that any swap or flip shows; its chest wall is at x = 0."""
    labels = np.zeros((7, 9, 11), np.uint8)
    labels[0:6, 2:7, 1:9] = 1
    labels[1:3, 3:5, 2:4] = 29
    labels[0, 2, 8] = 88
    labels[5, 4, 3:5] = 33
    return labels


def save(path: Path, labels: np.ndarray, zipped: bool = True) -> Path:
    """Save [x, y, z] in the format of the ending; ITK's formats get patient axes."""
    if path.name == SERIES or path.suffix == f".{SERIES}":
        return save_series(path, labels)
    if path.suffix == ".npy":
        np.save(path, labels)
    elif path.suffix == ".npz":
        (np.savez_compressed if zipped else np.savez)(
            path, labels=labels, voxel_mm=SPACING, origin_mm=ORIGIN
        )
    elif path.suffix == ".bin":  # a cube of codes of its own: test_phantom_thesis.py
        np.full((7, 7, 7), 203, "<i2").tofile(path)
    elif path.suffix == ".txt":  # media numbers of its own: test_phantom_uwcem.py
        save_uwcem(path, labels)
    elif path.suffix in (".tif", ".tiff"):
        save_tiff(path, labels, zipped)
    elif path.suffix == ".vctx":
        save_vctx(path, labels, zipped=zipped)
    else:
        save_itk(path, labels, zipped=zipped)
    return path


def save_uwcem(path: Path, labels: np.ndarray) -> Path:
    """Save [x, y, z] as the Wisconsin repository does: x from the nipple to the chest wall."""
    media = {0: "-1", 1: "3.1", 2: "-2", 29: "1.1", 33: "1.2", 40: "-4", 88: "2"}
    turned = labels[::-1]
    path.write_text("".join(f"{media[int(label)]}\n" for label in turned.ravel(order="F")))
    sides = "".join(f"s{axis + 1}={side}\n" for axis, side in enumerate(labels.shape))
    (path.parent / "breastInfo.txt").write_text(f"breast ID=071904\n{sides}class=2\n")
    return path


def save_itk(path: Path, labels: np.ndarray, axes: str = "ALS", zipped: bool = True) -> Path:
    """Save by SimpleITK an array whose axes run along the letters."""
    directions = np.zeros((3, 3))
    for file_axis, letter in enumerate(axes):
        axis, sense = AXIS_OF_LETTER[letter]
        directions[axis, file_axis] = sense
    image = sitk.GetImageFromArray(labels.transpose(2, 1, 0))
    image.SetSpacing(SPACING.tolist())
    image.SetOrigin((BREAST_FROM_LPS.T @ ORIGIN).tolist())
    image.SetDirection((BREAST_FROM_LPS.T @ directions).ravel().tolist())
    sitk.WriteImage(image, str(path), useCompression=zipped and path.suffix != ".mhd")
    return path


def save_tiff(path: Path, labels: np.ndarray, zipped: bool = True) -> Path:
    """Columns along x, rows along y, a page a layer of z, as ImageJ saves them."""
    width, height, depth = SPACING
    tifffile.imwrite(
        path, labels.transpose(2, 1, 0), imagej=not zipped, resolution=(1 / width, 1 / height),
        metadata={"spacing": depth, "unit": "mm", "axes": "ZYX"},
        compression="zlib" if zipped else None,
    )  # fmt: skip
    return path


def victre_header(**changes: str) -> str:
    lines = {
        "ObjectType": "Image", "NDims": "3", "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False", "CompressedData": "False",
        "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "3 -20 12.5",
        "ElementSpacing": "0.5 0.75 1.0", "DimSize": "7 9 11", "AnatomicalOrientation": "???",
        "ElementType": "MET_UCHAR", "ElementDataFile": "b.raw",
    }  # fmt: skip
    data_file = changes.get("ElementDataFile", lines.pop("ElementDataFile"))
    lines.update(changes)
    lines.pop("ElementDataFile", None)
    text = "".join(f"{key} = {value}\n" for key, value in lines.items())
    return text + f"ObjectType = Image\nElementDataFile = {data_file}\n"


def save_victre(folder: Path, raw: bytes | None = None, name: str = "b.raw.gz", **changes) -> Path:
    if raw is None:
        raw = gzip.compress(small_breast().tobytes(order="F"))
    (folder / name).write_bytes(raw)
    (folder / "b.mhd").write_text(victre_header(**changes))
    return folder / "b.mhd"


MATERIALS = {
    0: [("Air", 1.0, 0.0012)], 1: [("Adipose", 1.0, 0.93)], 2: [("Skin", 1.0, 0.93)],
    29: [("Glandular", 0.25, 1.04), ("Water", 0.75, 1.0)], 33: [("Nipple", 1.0, 1.04)],
    88: [("Ligament", 0.5, 1.04), ("Adipose", 0.5, 0.93)],
}  # fmt: skip
"""An Index_Table for the labels of the small breast: name, weight and density of materials."""


def vctx_description(shape, materials=None, laterality: str = "Right", **changes: str) -> str:
    """Phantom.xml with the fields that matter, named as OpenVCT names them."""
    indices = "".join(
        f"<Index><Index_ID>{index}</Index_ID><Number_Of_Materials>{len(parts)}"
        "</Number_Of_Materials><Materials>"
        + "".join(
            f"<Material><Material_Name>{name}</Material_Name><Material_Weight>{weight}"
            f"</Material_Weight><Material_Density>{density}</Material_Density>"
            "<Material_MaterialZ>205</Material_MaterialZ></Material>"
            for name, weight, density in parts
        )
        + "</Materials></Index>"
        for index, parts in (MATERIALS if materials is None else materials).items()
    )
    fields = {
        "X": shape[0], "Y": shape[1], "Z": shape[2], "SX": SPACING[0], "SY": SPACING[1],
        "SZ": SPACING[2], "order": "X | Y | Z", "type": "V_INT8", "bits": "8",
    }  # fmt: skip
    fields.update(changes)
    return (
        '<?xml version="1.0"?>\n<VCT_Phantom><Phantom_Name>b</Phantom_Name>'
        f"<Laterality>{laterality}</Laterality><Voxel_Array><VOXEL_NUM><X>{fields['X']}</X>"
        f"<Y>{fields['Y']}</Y><Z>{fields['Z']}</Z></VOXEL_NUM><VOXEL_SIZE_MM><X>{fields['SX']}"
        f"</X><Y>{fields['SY']}</Y><Z>{fields['SZ']}</Z></VOXEL_SIZE_MM><VOXEL_ARRAY_ORDER>"
        f"{fields['order']}</VOXEL_ARRAY_ORDER><VOXEL_TYPE>{fields['type']}</VOXEL_TYPE>"
        f"<Number_Bits>{fields['bits']}</Number_Bits></Voxel_Array>"
        f"<Index_Table><Maximum_Index>88</Maximum_Index>{indices}</Index_Table></VCT_Phantom>\n"
    )


def save_vctx(
    path: Path,
    labels: np.ndarray,
    description: str | None = None,
    names: tuple[str, ...] = ("b/Phantom.dat", "b/Phantom.xml"),
    zipped: bool = True,
) -> Path:
    content = (labels.tobytes(order="F"), description or vctx_description(labels.shape))
    method = zipfile.ZIP_DEFLATED if zipped else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, part in zip(names, content, strict=True):
            archive.writestr(name, part)
    return path


def save_series(folder: Path, labels: np.ndarray, axes: str = "ALS", **changes) -> Path:
    """One file a layer along the last axis, in an order of names that is not that of places."""
    folder.mkdir()
    directions = np.zeros((3, 3))
    for file_axis, letter in enumerate(axes):
        axis, sense = AXIS_OF_LETTER[letter]
        directions[axis, file_axis] = sense
    lps = BREAST_FROM_LPS.T @ directions
    corner = BREAST_FROM_LPS.T @ ORIGIN
    # The normal of a DICOM slice is row x column: a left-handed stack is stored from its end.
    handed = np.sign(np.linalg.det(lps))
    assert handed > 0, "give axes that are right-handed"
    for k in range(labels.shape[2]):
        dataset = dicom_slice(labels[:, :, k])
        dataset.ImageOrientationPatient = [*lps[:, 0], *lps[:, 1]]
        dataset.ImagePositionPatient = (corner + k * SPACING[2] * lps[:, 2]).tolist()
        dataset.InstanceNumber = k + 1
        for tag, value in changes.items():
            if value is None:
                dataset.pop(tag, None)
            else:
                setattr(dataset, tag, value)
        dataset.save_as(folder / f"{(7 * k) % 97:03d}.dcm", enforce_file_format=True)
    return folder


def dicom_slice(values: np.ndarray) -> pydicom.Dataset:
    """A picture of [column, row] without a place."""
    dataset = pydicom.Dataset()
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    dataset.file_meta.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
    dataset.file_meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid(entropy_srcs=["b"])
    dataset.SOPClassUID = pydicom.uid.CTImageStorage
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID
    dataset.SeriesInstanceUID = "1.2.3"
    dataset.Columns, dataset.Rows = values.shape
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    bits = 8 * values.dtype.itemsize
    dataset.BitsAllocated = dataset.BitsStored = bits
    dataset.HighBit = bits - 1
    dataset.PixelRepresentation = int(values.dtype.kind == "i")
    dataset.PixelSpacing = [SPACING[1], SPACING[0]]
    dataset.SliceThickness = SPACING[2]
    dataset.set_pixel_data(
        np.ascontiguousarray(values.T), "MONOCHROME2", bits, generate_instance_uid=False
    )
    return dataset

"""The attributes of a mammogram, module by module (PS3.3 A.26)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import (
    DigitalMammographyXRayImageStorageForPresentation,
    DigitalMammographyXRayImageStorageForProcessing,
)

from mammosim._version import VERSION
from mammosim.acquisition import Mammogram
from mammosim.export.identity import StudyIdentity
from mammosim.export.orientation import VIEW_CODES, patient_orientation, positioner_angle_deg
from mammosim.export.settings import ExportSettings
from mammosim.geometry import View

Intent = Literal["processing", "presentation"]

SOP_CLASS = {
    "processing": DigitalMammographyXRayImageStorageForProcessing,
    "presentation": DigitalMammographyXRayImageStorageForPresentation,
}
"""SOP Class of each intent."""

SERIES_NUMBER = {"processing": 1, "presentation": 2, "segmentation": 3, "measurements": 4}
"""Series Number of each kind of object."""

# Order in which a reader looks at a study: right before left, CC before MLO.
_READING_ORDER = ("RCC", "LCC", "RMLO", "LMLO", "RML", "LML")

# Defined Terms of Anode Target Material (0018,1191) and Filter Material (0018,7050).
_MATERIAL_TERM = {
    "W": "TUNGSTEN", "Mo": "MOLYBDENUM", "Rh": "RHODIUM", "Ag": "SILVER", "Al": "ALUMINUM",
    "Cu": "COPPER", "Ti": "TITANIUM", "Sn": "TIN",
}  # fmt: skip

DERIVATION = (
    "Simulated image: a labelled voxel breast was compressed numerically and X-rays were "
    "projected through it by mammosim. No patient was imaged."
)
"""Derivation Description."""

_EVENTS = ("Study", "Series", "Acquisition", "Content", "InstanceCreation")

_MGY_PER_DGY = 100.0  # Organ Dose (0040,0316) is in dGy
_UAS_PER_MAS = 1000.0


def set_attributes(dataset: Dataset, attributes: Mapping[str, Any]) -> None:
    """Set attributes by keyword; those that are None are left out."""
    for keyword, value in attributes.items():
        if value is not None:
            setattr(dataset, keyword, value)


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


def identification(
    study: StudyIdentity, settings: ExportSettings, series: str, view: View
) -> dict[str, Any]:
    """Patient, study, series and equipment of one object of a run.

    Parameters
    ----------
    study : StudyIdentity
    settings : ExportSettings
    series : {"processing", "presentation", "segmentation", "measurements"}
    view : View
    """
    return {
        "SpecificCharacterSet": "ISO_IR 192",
        "PatientName": study.patient_name,
        "PatientID": study.patient_id,
        "PatientBirthDate": "",
        "PatientSex": "F",
        "PatientComments": "Simulated; not a patient.",
        "StudyInstanceUID": study.uid("study"),
        "StudyID": "1",
        "StudyDescription": long_string(study.description),
        "AccessionNumber": "",
        "ReferringPhysicianName": "",
        **{f"{event}Date": settings.date for event in _EVENTS},
        **{f"{event}Time": "000000" for event in _EVENTS},
        "SeriesInstanceUID": study.uid("series", series),
        "SeriesNumber": SERIES_NUMBER[series],
        "InstanceNumber": _READING_ORDER.index(view.folder) + 1,
        "Manufacturer": "mammosim",
        "ManufacturerModelName": "mammosim",
        "DeviceSerialNumber": "simulated",
        "SoftwareVersions": VERSION,
    }


def image(study: StudyIdentity, intent: Intent, view: View) -> dict[str, Any]:
    """General Image, DX Series, DX Anatomy Imaged and the view."""
    value, meaning = VIEW_CODES[view.name]
    view_item = code_item(value, "SCT", meaning)
    view_item.ViewModifierCodeSequence = Sequence()
    return {
        "Modality": "MG",
        "PresentationIntentType": f"FOR {intent.upper()}",
        "SeriesDescription": f"Simulated mammogram, for {intent}",
        "PatientOrientation": patient_orientation(view),
        "BodyPartExamined": "BREAST",
        "ImageLaterality": view.laterality,
        "OrganExposed": "BREAST",
        "AnatomicRegionSequence": Sequence([code_item("76752008", "SCT", "Breast")]),
        "ViewCodeSequence": Sequence([view_item]),
        "ViewPosition": view.name,  # not needed beside the code, but what many tools read
        "BreastImplantPresent": "NO",
        "PartialView": "NO",
        "BurnedInAnnotation": "NO",
        "LossyImageCompression": "00",
        "DerivationDescription": DERIVATION,
        "ImageComments": "Simulated image.",
        "AcquisitionContextSequence": Sequence(),
        "IrradiationEventUID": study.uid("exposure", view.folder),
    }


def detector(mammogram: Mammogram) -> dict[str, Any]:
    """DX Detector: pixels, field of view and how it is turned."""
    gantry = mammogram.gantry
    pitch = decimal_string(gantry.pixel_mm)
    return {
        "DetectorType": "",
        "DetectorDescription": "Simulated flat-panel detector",
        "DetectorID": "simulated",
        "DetectorActiveShape": "RECTANGLE",
        "DetectorElementSpacing": [pitch, pitch],
        "ImagerPixelSpacing": [pitch, pitch],
        "FieldOfViewShape": "RECTANGLE",
        "FieldOfViewDimensions": [
            str(round(gantry.rows * gantry.pixel_mm)),
            str(round(gantry.columns * gantry.pixel_mm)),
        ],
        "FieldOfViewOrigin": ["0", "0"],
        "FieldOfViewRotation": "0" if gantry.view.laterality == "L" else "180",
        "FieldOfViewHorizontalFlip": "NO",
    }


def positioning(mammogram: Mammogram) -> dict[str, Any]:
    """Mammography Image: distances, magnification and angle.

    Magnification and Pixel Spacing are those of an object on the breast support, as Distance
    Source to Patient (PS3.3 C.8.11.7 and 10.7.1.3, calibration type GEOMETRY); Imager Pixel
    Spacing is the detector's.
    """
    gantry = mammogram.gantry
    to_support = gantry.source_to_detector_mm - gantry.support_to_detector_mm
    magnification = gantry.source_to_detector_mm / to_support
    spacing = decimal_string(gantry.pixel_mm / magnification)
    return {
        "PositionerType": "MAMMOGRAPHIC",
        "PositionerPrimaryAngle": decimal_string(positioner_angle_deg(gantry.view)),
        "PositionerPrimaryAngleDirection": "CC",
        "DistanceSourceToDetector": decimal_string(gantry.source_to_detector_mm),
        "DistanceSourceToPatient": decimal_string(to_support),
        "EstimatedRadiographicMagnificationFactor": decimal_string(magnification),
        "PixelSpacing": [spacing, spacing],
        "PixelSpacingCalibrationType": "GEOMETRY",
        "PixelSpacingCalibrationDescription": "At the surface of the breast support",
    }


def technique(mammogram: Mammogram) -> dict[str, Any]:
    """X-Ray Acquisition Dose, Filtration and Grid; what is not known is left out."""
    filter_mm = decimal_string(mammogram.filter_mm)
    dose_dgy = mammogram.dose_mgy / _MGY_PER_DGY
    return {
        "KVP": decimal_string(mammogram.kvp),
        "Exposure": _integer_string(mammogram.mas),
        "ExposureInuAs": _integer_string(mammogram.mas * _UAS_PER_MAS),
        "AnodeTargetMaterial": _material_term(mammogram.target),
        "FilterMaterial": _material_term(mammogram.filter),
        "FilterThicknessMinimum": filter_mm,
        "FilterThicknessMaximum": filter_mm,
        # The simulated grid leaves no lines in the image, as a moving one.
        "Grid": ["RECIPROCATING", "FOCUSED"] if mammogram.grid else "NONE",
        "BodyPartThickness": decimal_string(mammogram.thickness_mm),
        "CompressionForce": decimal_string(mammogram.force_n),
        "HalfValueLayer": decimal_string(mammogram.hvl_mm_al),
        "OrganDose": decimal_string(dose_dgy),
        "EntranceDoseInmGy": decimal_string(mammogram.air_kerma_mgy),
    }


def _integer_string(value: float) -> str | None:
    return str(round(value)) if math.isfinite(value) else None


def _material_term(symbol: str) -> str:
    return _MATERIAL_TERM.get(symbol, symbol.upper()[:16])


def processing() -> dict[str, Any]:
    """DX Image of raw pixels: linear in exposure, shown inverted so that gland is white."""
    return {
        "ImageType": ["ORIGINAL", "PRIMARY"],
        "PhotometricInterpretation": "MONOCHROME1",
        "PixelIntensityRelationship": "LIN",
        "PixelIntensityRelationshipSign": 1,
        "PresentationLUTShape": "INVERSE",
    }


def presentation(mammogram: Mammogram, study: StudyIdentity) -> dict[str, Any]:
    """DX Image of pixels for reading, with its window and a reference to the raw image."""
    source = Dataset()
    source.ReferencedSOPClassUID = SOP_CLASS["processing"]
    source.ReferencedSOPInstanceUID = study.uid("image", mammogram.gantry.view.folder, "processing")
    source.SpatialLocationsPreserved = "YES"
    purpose = code_item("121322", "DCM", "Source image for image processing operation")
    source.PurposeOfReferenceCodeSequence = Sequence([purpose])
    return {
        "ImageType": ["DERIVED", "PRIMARY"],
        "SourceImageSequence": Sequence([source]),
        "PhotometricInterpretation": "MONOCHROME2",
        "PixelIntensityRelationship": "LOG",
        "PixelIntensityRelationshipSign": -1,
        "PresentationLUTShape": "IDENTITY",
        "WindowCenter": decimal_string(mammogram.window_center),
        "WindowWidth": decimal_string(mammogram.window_width),
        "WindowCenterWidthExplanation": "Standard",
        "VOILUTFunction": "LINEAR",
    }


def pixel_data(pixels: NDArray[np.uint16]) -> dict[str, Any]:
    """Image Pixel: 16 bits, unsigned."""
    rows, columns = pixels.shape
    return {
        "SamplesPerPixel": 1,
        "Rows": rows,
        "Columns": columns,
        "BitsAllocated": 16,
        "BitsStored": 16,
        "HighBit": 15,
        "PixelRepresentation": 0,
        "RescaleIntercept": "0",
        "RescaleSlope": "1",
        "RescaleType": "US",
        "PixelData": np.ascontiguousarray(pixels, dtype="<u2").tobytes(),
    }

"""The attributes of a mammogram, module by module (PS3.3 A.26)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import (
    DigitalMammographyXRayImageStorageForPresentation,
    DigitalMammographyXRayImageStorageForProcessing,
)

from mammosim.acquisition import DETECTORS, Mammogram
from mammosim.export.dicom_object import code_item, decimal_string
from mammosim.export.dicom_series import Intent, exposure_uid, image_uid, series_description
from mammosim.export.identity import StudyIdentity
from mammosim.export.orientation import (
    VIEW_CODES,
    patient_orientation,
    positioner_angle_deg,
    view_modifiers,
)
from mammosim.geometry import Gantry

SOP_CLASS = {
    "processing": DigitalMammographyXRayImageStorageForProcessing,
    "presentation": DigitalMammographyXRayImageStorageForPresentation,
}
"""SOP Class of each intent."""

BITS_STORED = {"processing": 14, "presentation": 12}
"""Bits of a pixel of each intent."""

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

# Defined Terms of Detector Type (0018,7004) by converter.
_DETECTOR_TYPE = {"Se": "DIRECT", "CsI": "SCINTILLATOR"}

# Of mammography tubes with their large focal spot; it only divides the tube load into a current
# and a time. Assumed.
TUBE_CURRENT_MA = 100.0

# Of the small focal spot, nominally 0.1 mm, up to which size: its anode takes about a quarter of
# the current (25 mA is the usual limit of textbooks).
SMALL_SPOT_MM, SMALL_SPOT_CURRENT_MA = 0.15, 25.0

_MGY_PER_DGY = 100.0  # Organ Dose (0040,0316) is in dGy
_UAS_PER_MAS = 1000.0


def image(
    study: StudyIdentity, intent: Intent, mammogram: Mammogram, draw: int = 1
) -> dict[str, Any]:
    """General Image, DX Series, DX Anatomy Imaged and the view with its modifiers."""
    gantry, view = mammogram.gantry, mammogram.gantry.view
    value, meaning = VIEW_CODES[view.name]
    view_item = code_item(value, "SCT", meaning)
    view_item.ViewModifierCodeSequence = Sequence(
        [code_item(code, "SCT", meaning) for code, meaning in view_modifiers(gantry)]
    )
    return {
        "Modality": "MG",
        "PresentationIntentType": f"FOR {intent.upper()}",
        "SeriesDescription": series_description(
            view, "" if intent == "presentation" else " for processing"
        ),
        "PatientOrientation": patient_orientation(view),
        "BodyPartExamined": "BREAST",
        "ImageLaterality": view.laterality,
        "OrganExposed": "BREAST",
        "AnatomicRegionSequence": Sequence([code_item("76752008", "SCT", "Breast")]),
        "ViewCodeSequence": Sequence([view_item]),
        "ViewPosition": view.name,  # not needed beside the code, but what many tools read
        "BreastImplantPresent": "YES" if mammogram.implant else "NO",
        "PartialView": "NO",
        "BurnedInAnnotation": "NO",
        "LossyImageCompression": "00",
        "DerivationDescription": DERIVATION,
        "ImageComments": "Simulated image.",
        "AcquisitionContextSequence": Sequence(),
        "IrradiationEventUID": exposure_uid(study, view, draw),
    }


def detector(mammogram: Mammogram) -> dict[str, Any]:
    """DX Detector: pixels, field of view and how it is turned."""
    gantry = mammogram.gantry
    pitch = decimal_string(gantry.pixel_mm)
    return {
        "DetectorType": detector_type(mammogram),
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


def detector_type(mammogram: Mammogram) -> str:
    """Detector Type by what converts the photons; empty where that is not known."""
    found = DETECTORS.get(mammogram.detector)
    return _DETECTOR_TYPE.get((found.material or "") if found else "", "")


def breast_pixel_mm(gantry: Gantry) -> float:
    """Pixel Spacing of all objects: of an object at the surface of the breast support, mm."""
    to_support = gantry.source_to_detector_mm - gantry.support_to_detector_mm
    return gantry.pixel_mm * to_support / gantry.source_to_detector_mm


def positioning(mammogram: Mammogram) -> dict[str, Any]:
    """Mammography Image: distances, magnification and angle.

    Magnification and Pixel Spacing are those of an object on the breast support, as Distance
    Source to Patient (PS3.3 C.8.11.7 and 10.7.1.3, calibration type GEOMETRY); Imager Pixel
    Spacing is the detector's.
    """
    gantry = mammogram.gantry
    to_support = gantry.source_to_detector_mm - gantry.support_to_detector_mm
    spacing = decimal_string(breast_pixel_mm(gantry))
    return {
        "PositionerType": "MAMMOGRAPHIC",
        "PositionerPrimaryAngle": decimal_string(positioner_angle_deg(gantry.view)),
        "PositionerPrimaryAngleDirection": "CC",
        "DistanceSourceToDetector": decimal_string(gantry.source_to_detector_mm),
        "DistanceSourceToPatient": decimal_string(to_support),
        "EstimatedRadiographicMagnificationFactor": decimal_string(gantry.magnification),
        "PixelSpacing": [spacing, spacing],
        "PixelSpacingCalibrationType": "GEOMETRY",
        "PixelSpacingCalibrationDescription": "At the surface of the breast support",
    }


def technique(mammogram: Mammogram) -> dict[str, Any]:
    """X-Ray Acquisition Dose, Filtration and Grid; what is not known is left out."""
    filter_mm = decimal_string(mammogram.filter_mm)
    dose_dgy = mammogram.dose_mgy / _MGY_PER_DGY
    spot_mm = mammogram.focal_spot_mm
    measures = mammogram.measures
    current_ma = SMALL_SPOT_CURRENT_MA if spot_mm <= SMALL_SPOT_MM else TUBE_CURRENT_MA
    return {
        "KVP": decimal_string(mammogram.kvp),
        "Exposure": _integer_string(mammogram.mas),
        "ExposureInuAs": _integer_string(mammogram.mas * _UAS_PER_MAS),
        "ExposureTime": _integer_string(1e3 * mammogram.mas / current_ma),
        "XRayTubeCurrent": _integer_string(current_ma),
        "ExposureControlMode": "AUTOMATIC" if mammogram.automatic_exposure else "MANUAL",
        "RelativeXRayExposure": _integer_string(measures.get("exposure_index", math.nan)),
        "FocalSpots": decimal_string(spot_mm),
        "AnodeTargetMaterial": material_term(mammogram.target),
        "FilterMaterial": material_term(mammogram.filter),
        "FilterThicknessMinimum": filter_mm,
        "FilterThicknessMaximum": filter_mm,
        # The simulated grid leaves no lines in the image, as a moving one.
        "Grid": ["RECIPROCATING", "FOCUSED"] if mammogram.grid else "NONE",
        "BodyPartThickness": decimal_string(mammogram.thickness_mm),
        "CompressionForce": decimal_string(mammogram.force_n),
        "CompressionPressure": decimal_string(measures.get("pressure_kpa", math.nan)),
        "CompressionContactArea": decimal_string(measures.get("contact_area_mm2", math.nan)),
        "HalfValueLayer": decimal_string(mammogram.hvl_mm_al),
        "OrganDose": decimal_string(dose_dgy),
        "EntranceDoseInmGy": decimal_string(mammogram.air_kerma_mgy),
    }


def _integer_string(value: float) -> str | None:
    return str(round(value)) if math.isfinite(value) else None


def material_term(symbol: str) -> str:
    """Name of an anode's or a filter's material, as DICOM has it."""
    return _MATERIAL_TERM.get(symbol, symbol.upper()[:16])


def processing() -> dict[str, Any]:
    """DX Image of raw pixels: linear in exposure, shown inverted so that gland is white."""
    return {
        "ImageType": ["ORIGINAL", "PRIMARY"],
        "AcquisitionDeviceProcessingDescription": "Not flat-fielded, linear in exposure",
        "PhotometricInterpretation": "MONOCHROME1",
        "PixelIntensityRelationship": "LIN",
        "PixelIntensityRelationshipSign": 1,
        "PresentationLUTShape": "INVERSE",
    }


def presentation(mammogram: Mammogram, study: StudyIdentity, draw: int = 1) -> dict[str, Any]:
    """DX Image of pixels for reading, with its window and a reference to the raw image."""
    source = source_image(image_uid(study, mammogram.gantry.view, "processing", draw))
    return {
        "ImageType": ["DERIVED", "PRIMARY"],
        "AcquisitionDeviceProcessingDescription": "Logarithm, thickness equalization, tone curve",
        "SourceImageSequence": Sequence([source]),
        "PhotometricInterpretation": "MONOCHROME2",
        "PixelIntensityRelationship": "LOG",
        "PixelIntensityRelationshipSign": -1,
        "PresentationLUTShape": "IDENTITY",
        "WindowCenter": decimal_string(mammogram.window_center),
        "WindowWidth": decimal_string(mammogram.window_width),
        "WindowCenterWidthExplanation": "Standard",
    }


def source_image(uid: str) -> Dataset:
    """An item of Source Image Sequence: the raw image that another was made from."""
    source = Dataset()
    source.ReferencedSOPClassUID = SOP_CLASS["processing"]
    source.ReferencedSOPInstanceUID = uid
    source.SpatialLocationsPreserved = "YES"
    purpose = code_item("121322", "DCM", "Source image for image processing operation")
    source.PurposeOfReferenceCodeSequence = Sequence([purpose])
    return source


def pixel_format(rows: int, columns: int, bits: int) -> dict[str, Any]:
    """How the pixels of one frame are stored: unsigned, in 16 bits."""
    return {
        "SamplesPerPixel": 1,
        "Rows": rows,
        "Columns": columns,
        "BitsAllocated": 16,
        "BitsStored": bits,
        "HighBit": bits - 1,
        "PixelRepresentation": 0,
    }


def pixel_data(pixels: NDArray[np.uint16], bits: int) -> dict[str, Any]:
    """Image Pixel: unsigned, of which as many bits are used as the intent has.

    Bits Stored is exact because some readers (ITK) turn MONOCHROME1 about its largest value.
    """
    rows, columns = pixels.shape
    largest = int(pixels.max(initial=0))
    if largest >> bits:
        raise ValueError(f"pixel value: found {largest}, expected at most {2**bits - 1}")
    return {
        **pixel_format(rows, columns, bits),
        "RescaleIntercept": "0",
        "RescaleSlope": "1",
        "RescaleType": "US",
        "PixelData": np.ascontiguousarray(pixels, dtype="<u2").tobytes(),
    }

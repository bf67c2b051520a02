"""What the multi-frame objects of tomosynthesis have in common (PS3.3 A.55 and A.74)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydicom import Dataset
from pydicom.sequence import Sequence

from mammosim.acquisition import Mammogram
from mammosim.export.dicom_modules import (
    DERIVATION,
    TUBE_CURRENT_MA,
    detector_type,
    material_term,
)
from mammosim.export.dicom_object import code_item, set_attributes
from mammosim.export.dicom_series import identification, series_description
from mammosim.export.identity import StudyIdentity
from mammosim.export.orientation import VIEW_CODES
from mammosim.export.settings import ExportSettings
from mammosim.geometry import View

# 25 degrees in 20 s on a Mammomat Inspiration; it only fills Acquisition Duration. Assumed.
SECONDS_PER_PROJECTION = 1.0


def item_of(attributes: Mapping[str, Any]) -> Dataset:
    """One item of a sequence; what is None is left out."""
    item = Dataset()
    set_attributes(item, attributes)
    return item


def sequence_of(**attributes: Any) -> Sequence:
    """A sequence of one item."""
    return Sequence([item_of(attributes)])


def series_and_equipment(
    study: StudyIdentity, settings: ExportSettings, kind: str, view: View, suffix: str
) -> dict[str, Any]:
    """Patient, study, series, equipment, frame of reference and view of an object."""
    value, meaning = VIEW_CODES[view.name]
    seen = code_item(value, "SCT", meaning)
    seen.ViewModifierCodeSequence = Sequence()
    return {
        **identification(study, settings, kind, view),
        "Modality": "MG",
        "SeriesDescription": series_description(view, suffix),
        "FrameOfReferenceUID": study.uid("frame", view.folder),
        "PositionReferenceIndicator": "",
        "ViewCodeSequence": Sequence([seen]),
        "BreastImplantPresent": "NO",
        "PartialView": "NO",
        "AcquisitionDateTime": f"{settings.date}000000",
        "AcquisitionContextSequence": Sequence(),
        "BurnedInAnnotation": "NO",
        "DerivationDescription": DERIVATION,
        "LossyImageCompression": "00",
        "ContentQualification": "RESEARCH",
        "ImageComments": "Simulated image.",
    }


def exposure_of_all(middle: Mammogram, loads_mas: Any) -> dict[str, Any]:
    """Technique of a whole series of projections, as its modules of acquisition want it."""
    load = float(sum(loads_mas))
    filter_mm = middle.filter_mm
    return {
        "KVP": f"{middle.kvp:.6g}",
        "ExposureInmAs": load,
        "ExposureTimeInms": 1e3 * load / TUBE_CURRENT_MA,
        "XRayTubeCurrentInmA": TUBE_CURRENT_MA,
        "FocalSpots": f"{middle.focal_spot_mm:.6g}",
        "AnodeTargetMaterial": material_term(middle.target),
        "FilterMaterial": material_term(middle.filter),
        "FilterType": "FLAT",
        "FilterThicknessMinimum": f"{filter_mm:.6g}",
        "FilterThicknessMaximum": f"{filter_mm:.6g}",
        "BodyPartThickness": f"{middle.thickness_mm:.6g}",
        "CompressionForce": f"{middle.force_n:.6g}",
        "AcquisitionDuration": SECONDS_PER_PROJECTION * len(loads_mas),
        "DetectorType": detector_type(middle),
    }


def values_as_stored(bits: int) -> dict[str, Sequence]:
    """Functional groups of values that are shown as stored, in a window over all of them."""
    values = 1 << bits
    return {
        "PixelValueTransformationSequence": sequence_of(
            RescaleIntercept="0", RescaleSlope="1", RescaleType="US"
        ),
        "FrameVOILUTSequence": sequence_of(
            WindowCenter=f"{0.5 * values:g}",
            WindowWidth=f"{values}",
            WindowCenterWidthExplanation="Whole range",
        ),
    }


def frame_content(
    settings: ExportSettings, acquisition: int, place: int, duration_s: float
) -> Sequence:
    """Frame Content Sequence of one frame of the object's one stack; numbers count from 1."""
    return sequence_of(
        FrameAcquisitionNumber=acquisition,
        FrameReferenceDateTime=f"{settings.date}000000",
        FrameAcquisitionDateTime=f"{settings.date}000000",
        FrameAcquisitionDuration=1e3 * duration_s,
        StackID="1",
        InStackPositionNumber=place,
    )


def frame_anatomy(view: View) -> Sequence:
    """Frame Anatomy Sequence."""
    return sequence_of(
        FrameLaterality=view.laterality,
        AnatomicRegionSequence=Sequence([code_item("76752008", "SCT", "Breast")]),
    )

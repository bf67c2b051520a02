"""Measurements of the lesions as a DICOM structured report (PS3.16 TID 1500)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike

import numpy as np
from highdicom import sr
from pydicom import Dataset
from pydicom.sr.coding import Code

from mammosim.acquisition import Mammogram
from mammosim.export.derived_objects import place_in_study, settle
from mammosim.export.dicom import mammogram_dataset
from mammosim.export.dicom_modules import breast_pixel_mm
from mammosim.export.dicom_object import long_string, save_object
from mammosim.export.identity import StudyIdentity
from mammosim.export.lesion_masks import LesionMask
from mammosim.export.segmentation import lesion_codes, segmentation_dataset
from mammosim.export.settings import ExportSettings

# Names and units of PS3.16 CID 7470, 7471 and 7181.
_AREA, _MM2 = Code("42798000", "SCT", "Area"), Code("mm2", "UCUM", "square millimeter")
_VOLUME, _MM3 = Code("118565006", "SCT", "Volume"), Code("mm3", "UCUM", "cubic millimeter")
_TITLE = Code("126000", "DCM", "Imaging Measurement Report")
_MAMMOGRAPHY = Code("71651007", "SCT", "Mammography")
_DEVICE = Code("121007", "DCM", "Device")

# PS3.16: "Breast composition" is in CID 6052, 111046 in annex D.
_COMPOSITION = Code("129715009", "SCT", "Breast composition")
_FIBROGLANDULAR = Code("111046", "DCM", "Percent Fibroglandular Tissue")
_PERCENT = Code("%", "UCUM", "percent")
_BREAST = Code("76752008", "SCT", "Breast")
_SIDE = {"L": Code("7771000", "SCT", "Left"), "R": Code("24028007", "SCT", "Right")}

_REFERENCED_SOP_SEQUENCE = 0x00081199
"""Tag of DICOM's Referenced SOP Sequence (PS3.6)."""


def write_measurements(
    masks: Sequence[LesionMask],
    mammogram: Mammogram,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write what is known of each lesion in a view and of its breast as a Comprehensive SR.

    Parameters
    ----------
    masks : sequence of LesionMask
        At least one of them with a pixel, by rising target id; those without are left out.
    mammogram : Mammogram
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    One measurement group (TID 1410) a lesion: its shadow's area, and its volume before compression.
    The area is in the scale of Pixel Spacing, that of an object on the breast support; a lesion
    above it is smaller than its shadow. A group has the tracking identifiers of the segmentation
    and refers to the lesion's frame in it. One more group (TID 1501) holds the breast's density.
    """
    view = mammogram.gantry.view
    source = mammogram_dataset(mammogram, "presentation", study, settings)
    segmentation = segmentation_dataset(masks, mammogram, study, settings)
    groups = [
        _group(number, lesion, mammogram, segmentation, source)
        for number, lesion in enumerate(masks, start=1)
        if lesion.mask.any()
    ]
    groups.extend(_density(mammogram, study))
    observer = sr.ObserverContext(
        observer_type=_DEVICE,
        observer_identifying_attributes=sr.DeviceObserverIdentifyingAttributes(
            uid=study.uid("device"), name="mammosim"
        ),
    )
    content = sr.MeasurementReport(
        observation_context=sr.ObservationContext(observer_device_context=observer),
        procedure_reported=_MAMMOGRAPHY,
        imaging_measurements=groups,
        title=_TITLE,
    )
    report = sr.ComprehensiveSR(
        evidence=[source, segmentation],
        content=content,
        **place_in_study(study, "measurements", view),
        is_complete=True,
        is_verified=False,
    )
    settle(report, study, settings, "measurements", view, " measurements")
    _leave_one_reference(report)
    save_object(report, path)


def _group(
    number: int,
    lesion: LesionMask,
    mammogram: Mammogram,
    segmentation: Dataset,
    source: Dataset,
) -> sr.PlanarROIMeasurementsAndQualitativeEvaluations:
    target, segment = lesion.target, segmentation.SegmentSequence[number - 1]
    area = float(np.count_nonzero(lesion.mask)) * breast_pixel_mm(mammogram.gantry) ** 2
    measured = [sr.Measurement(name=_AREA, value=round(area, 4), unit=_MM2)]
    if target.volume_mm3 > 0.0:
        volume = round(float(target.volume_mm3), 4)
        measured.append(sr.Measurement(name=_VOLUME, value=volume, unit=_MM3))
    shared = segmentation.SharedFunctionalGroupsSequence[0]
    frames = [
        place
        for place, frame in enumerate(segmentation.PerFrameFunctionalGroupsSequence, start=1)
        if _segment_number(frame, shared) == number
    ]
    return sr.PlanarROIMeasurementsAndQualitativeEvaluations(
        tracking_identifier=sr.TrackingIdentifier(
            uid=segment.TrackingUID, identifier=long_string(segment.TrackingID)
        ),
        referenced_segment=sr.ReferencedSegmentationFrame(
            sop_class_uid=segmentation.SOPClassUID,
            sop_instance_uid=segmentation.SOPInstanceUID,
            frame_number=frames[0],
            segment_number=number,
            source_image=sr.SourceImageForSegmentation(source.SOPClassUID, source.SOPInstanceUID),
        ),
        finding_type=lesion_codes(target.kind)[1],
        measurements=measured,
    )


def _density(
    mammogram: Mammogram, study: StudyIdentity
) -> list[sr.MeasurementsAndQualitativeEvaluations]:
    """A group with the volumetric density of the breast, where it is known."""
    density = mammogram.measures.get("volumetric_density_percent", math.nan)
    if not math.isfinite(density):
        return []
    view = mammogram.gantry.view
    return [
        sr.MeasurementsAndQualitativeEvaluations(
            tracking_identifier=sr.TrackingIdentifier(
                uid=study.uid("density", view.folder), identifier="Breast density"
            ),
            finding_type=_COMPOSITION,
            finding_sites=[sr.FindingSite(_BREAST, laterality=_SIDE[view.laterality])],
            measurements=[
                sr.Measurement(name=_FIBROGLANDULAR, value=round(density, 2), unit=_PERCENT)
            ],
        )
    ]


def _segment_number(frame: Dataset, shared: Dataset) -> int:
    """Segment of a frame; where all frames are of one, it may stand with what they share."""
    where = frame if "SegmentIdentificationSequence" in frame else shared
    return int(where.SegmentIdentificationSequence[0].ReferencedSegmentNumber)


def _leave_one_reference(report: Dataset) -> None:
    """Take out what the standard does not allow beside a frame number."""
    for element in report.iterall():
        if element.tag == _REFERENCED_SOP_SEQUENCE:
            for item in element.value:
                if "ReferencedFrameNumber" in item and "ReferencedSegmentNumber" in item:
                    del item.ReferencedSegmentNumber  # PS3.3 10.3: one of the two

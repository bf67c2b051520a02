"""The lesion mask as a DICOM Segmentation that refers to the mammogram for reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import highdicom as hd
import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sr.coding import Code

from mammosim._version import VERSION
from mammosim.acquisition import Mammogram
from mammosim.export.derived_objects import place_in_study, settle
from mammosim.export.dicom import mammogram_dataset
from mammosim.export.dicom_object import long_string, save_object
from mammosim.export.identity import StudyIdentity
from mammosim.export.lesion_masks import LesionMask
from mammosim.export.orientation import patient_orientation
from mammosim.export.settings import ExportSettings
from mammosim.phantom import LESION_KINDS
from mammosim.targets import Target

LESION_COLORS = ("yellow", "cyan", "magenta", "lime", "orange", "deepskyblue")
"""Recommended display colours of segments (names of CSS), in turn."""

# CID 7162 has no word for a projection of known truth; the masks come from a deformed model.
_FAMILY = Code("123111", "DCM", "Deformable Models")


def lesion_codes(kind: str) -> tuple[Code, Code]:
    """Category and type of a kind of lesion."""
    of_kind = LESION_KINDS[kind]
    return Code(*of_kind.dicom_category), Code(*of_kind.dicom_type)


def write_segmentation(
    masks: Sequence[LesionMask],
    mammogram: Mammogram,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write the masks as one binary DICOM Segmentation, a segment a lesion.

    Parameters
    ----------
    masks : sequence of LesionMask
        At least one, by rising target id.
    mammogram : Mammogram
        The image they lie on; the segmentation refers to the object for presentation.
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    DICOM numbers segments 1, 2, 3 without gaps (PS3.3 C.8.20.2), so a segment's number is its
    target's id where lesions come first among the targets. The id itself is in the segment's
    description and in its Tracking ID in any case.
    """
    segmentation = segmentation_dataset(masks, mammogram, study, settings)
    save_object(segmentation, path)


def segmentation_dataset(
    masks: Sequence[LesionMask],
    mammogram: Mammogram,
    study: StudyIdentity,
    settings: ExportSettings,
) -> hd.seg.Segmentation:
    """Make the segmentation; the parameters are `write_segmentation`'s."""
    view = mammogram.gantry.view
    source = mammogram_dataset(mammogram, "presentation", study, settings)
    segmentation = lesion_segmentation(
        source,
        np.stack([lesion.mask for lesion in masks], axis=-1)[np.newaxis],
        [lesion.target for lesion in masks],
        study,
        place_in_study(study, "segmentation", view),
        pixel_measures=hd.PixelMeasuresSequence(
            pixel_spacing=source.PixelSpacing, slice_thickness=mammogram.thickness_mm
        ),
        content_description="Where each simulated lesion projects",
        # highdicom wants one frame at least, and keeps empty ones if it is told to.
        omit_empty_frames=any(lesion.mask.any() for lesion in masks),
    )
    _settle(segmentation, mammogram, study, settings)
    return segmentation


def lesion_segmentation(
    source: Dataset,
    pixels: NDArray[np.bool_],
    targets: Sequence[Target],
    study: StudyIdentity,
    place: Mapping[str, Any],
    **own: Any,
) -> hd.seg.Segmentation:
    """Make a binary segmentation with one segment per lesion.

    Parameters
    ----------
    source : pydicom.Dataset
        The object that it refers to.
    pixels : ndarray of bool, [frame, row, column, segment]
    targets : sequence of Target
        One per segment.
    study : StudyIdentity
    place : mapping
        See `place_in_study`.
    **own
        Further arguments of `highdicom.seg.Segmentation`.
    """
    return hd.seg.Segmentation(
        source_images=[source],
        pixel_array=pixels,
        segmentation_type=hd.seg.SegmentationTypeValues.BINARY,
        segment_descriptions=[
            _segment_description(number, target, study)
            for number, target in enumerate(targets, start=1)
        ],
        **place,
        manufacturer_model_name="mammosim",
        software_versions=VERSION,
        device_serial_number="simulated",
        content_label="LESIONS",
        **own,
    )


def _segment_description(
    number: int, target: Target, study: StudyIdentity
) -> hd.seg.SegmentDescription:
    """What a segment stands for: kind, name and target id of a lesion."""
    category, kind = lesion_codes(target.kind)
    description = hd.seg.SegmentDescription(
        segment_number=number,
        segment_label=long_string(target.name),
        segmented_property_category=category,
        segmented_property_type=kind,
        algorithm_type=hd.seg.SegmentAlgorithmTypeValues.AUTOMATIC,
        algorithm_identification=hd.AlgorithmIdentificationSequence(
            name="mammosim projection of the known lesion",
            family=_FAMILY,
            version=VERSION,
        ),
        tracking_uid=study.uid("lesion", str(target.target_id)),
        tracking_id=long_string(f"{target.target_id} {target.name}"),
        anatomic_regions=[Code("76752008", "SCT", "Breast")],
    )
    color = LESION_COLORS[(number - 1) % len(LESION_COLORS)]
    description.RecommendedDisplayCIELabValue = list(hd.color.CIELabColor.from_string(color).value)
    description.SegmentDescription = f"target_id {target.target_id} of lesions.csv"
    return description


def _settle(
    segmentation: Dataset, mammogram: Mammogram, study: StudyIdentity, settings: ExportSettings
) -> None:
    """Put in what highdicom leaves out, and replace the clock and its random UIDs."""
    view = mammogram.gantry.view
    settle(segmentation, study, settings, "segmentation", view, " lesion masks", is_image=True)
    # The spacing is that of the image referred to. highdicom writes none without a slice thickness,
    # but a projection has none, and viewers that find one make a volume of the shadow.
    del segmentation.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence
    segmentation.PatientOrientation = patient_orientation(view)
    set_dimensions(segmentation, study.uid("dimensions", view.folder))


def set_dimensions(segmentation: Dataset, uid: str) -> None:
    """Replace the random UID of the frames' dimensions."""
    for item in (*segmentation.DimensionOrganizationSequence, *segmentation.DimensionIndexSequence):
        item.DimensionOrganizationUID = uid

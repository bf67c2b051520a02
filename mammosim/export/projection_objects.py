"""Breast Projection X-Ray Image objects: the projections of tomosynthesis, one frame each."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import NDArray
from pydicom import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import (
    BreastProjectionXRayImageStorageForPresentation,
    BreastProjectionXRayImageStorageForProcessing,
)

from mammosim.acquisition import Tomosynthesis
from mammosim.export.dicom_modules import BITS_STORED, TUBE_CURRENT_MA, pixel_format
from mammosim.export.dicom_object import (
    code_item,
    decimal_string,
    save_object,
    set_attributes,
    set_identity,
)
from mammosim.export.dicom_series import Intent
from mammosim.export.enhanced_modules import (
    SECONDS_PER_PROJECTION,
    exposure_of_all,
    frame_anatomy,
    frame_content,
    item_of,
    sequence_of,
    series_and_equipment,
    values_as_stored,
)
from mammosim.export.identity import StudyIdentity
from mammosim.export.orientation import positioner_angle_deg
from mammosim.export.settings import ExportSettings
from mammosim.geometry import Gantry

SOP_CLASS = {
    "processing": BreastProjectionXRayImageStorageForProcessing,
    "presentation": BreastProjectionXRayImageStorageForPresentation,
}
"""SOP Class of each intent."""

KIND = {"processing": "raw projections", "presentation": "projections"}
"""Of the series of each intent, as `identification` takes it."""


def write_projections(
    series: Tomosynthesis,
    intent: Intent,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write all projections as one Breast Projection X-Ray Image object.

    Parameters
    ----------
    series : Tomosynthesis
    intent : {"processing", "presentation"}
        Pixels linear in exposure, or their logarithm with one window for all frames.
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    dataset = projections_dataset(series, intent, study, settings)
    save_object(dataset, path)


def projections_dataset(
    series: Tomosynthesis, intent: Intent, study: StudyIdentity, settings: ExportSettings
) -> Dataset:
    """Make the object; the parameters are `write_projections`'s."""
    middle, raw = series.middle, intent == "processing"
    view = middle.gantry.view
    pixels = series.projections if raw else logarithms(series)
    count, rows, columns = pixels.shape
    dataset = Dataset()
    suffix = " projections" if not raw else " projections for processing"
    for attributes in (
        series_and_equipment(study, settings, KIND[intent], view, suffix),
        exposure_of_all(middle, series.loads_mas),
        {
            "ImageType": _image_type(intent),
            "PresentationIntentType": f"FOR {intent.upper()}",
            **_motion(series),
            "PositionerType": "MAMMOGRAPHIC",
            "PhotometricInterpretation": "MONOCHROME1" if raw else "MONOCHROME2",
            "PresentationLUTShape": "INVERSE" if raw else "IDENTITY",
            "ExposureControlMode": "AUTOMATIC" if middle.automatic_exposure else "MANUAL",
            "ExposureControlModeDescription": "As for a mammogram, split over all projections",
            "PaddleDescription": "Simulated flat paddle",
            "OrganDose": f"{series.dose_mgy / 100.0:.6g}",  # dGy
            "EntranceDoseInmGy": f"{series.air_kerma_mgy:.6g}",
            **pixel_format(rows, columns, BITS_STORED[intent]),
            "NumberOfFrames": str(count),
            "SharedFunctionalGroupsSequence": Sequence([_shared(series, intent, study)]),
            "PerFrameFunctionalGroupsSequence": Sequence(
                [_frame(series, index, settings) for index in range(count)]
            ),
            "IrradiationEventUID": study.uid("exposure", view.folder),
            "DetectorConditionsNominalFlag": "YES",
            "DetectorID": "simulated",
            "PatientOrientationCodeSequence": Sequence(
                [code_item("10904000", "SCT", "Orthostatic body position")]
            ),
        },
    ):
        set_attributes(dataset, attributes)
    dataset.PixelData = np.ascontiguousarray(pixels, "<u2").tobytes()
    set_identity(dataset, SOP_CLASS[intent], study.uid("image", view.folder, KIND[intent]))
    return dataset


def _motion(series: Tomosynthesis) -> dict[str, str]:
    """How tube and detector move, by Defined Terms of PS3.3 C.8.31.1.1: in steps."""
    turns = any(gantry.detector_angle_deg for gantry in series.gantries)
    return {
        "PositionerMotion": "ROTATION_STEP" if len(series.gantries) > 1 else "STATIONARY",
        "TypeOfDetectorMotion": "ROTATION_STEP" if turns else "STATIONARY",
    }


def logarithms(series: Tomosynthesis) -> NDArray[np.uint16]:
    """All projections for reading: attenuation in 12 bits, 0 in air, with one scale.

    Returns
    -------
    ndarray of uint16, [projection, row, column]
    """
    largest = (1 << BITS_STORED["presentation"]) - 1
    pictures = np.empty(series.projections.shape, np.uint16)
    top = float(np.quantile(series.attenuation(series.gantries.index(series.middle.gantry)), 0.999))
    scale = largest / max(1.2 * top, 1e-6)  # room for the oblique rays' longer way
    for index, picture in enumerate(pictures):
        picture[:] = np.clip(np.rint(series.attenuation(index) * scale), 0, largest)
    return pictures


def _shared(series: Tomosynthesis, intent: Intent, study: StudyIdentity) -> Dataset:
    """Functional groups that are the same for all frames."""
    raw, gantry = intent == "processing", series.middle.gantry
    pitch = f"{gantry.pixel_mm:.6g}"
    rows_mm, columns_mm = gantry.rows * gantry.pixel_mm, gantry.columns * gantry.pixel_mm
    groups = {
        "FrameAnatomySequence": frame_anatomy(gantry.view),
        **values_as_stored(BITS_STORED[intent]),
        "FramePixelDataPropertiesSequence": sequence_of(
            FrameType=_image_type(intent),
            PixelIntensityRelationship="LIN" if raw else "LOG",
            PixelIntensityRelationshipSign=1 if raw else -1,
            GeometricalProperties="UNIFORM",
            ImageProcessingApplied="NONE" if raw else "LOG",
            ImagerPixelSpacing=[pitch, pitch],
        ),
        "XRayGridSequence": sequence_of(Grid="FIXED" if series.middle.grid else "NONE"),
        "FieldOfViewSequence": sequence_of(
            FieldOfViewShape="RECTANGLE",
            FieldOfViewDimensionsInFloat=[rows_mm, columns_mm],
            FieldOfViewOrigin=["0", "0"],
            FieldOfViewRotation="0" if gantry.view.laterality == "L" else "180",
            FieldOfViewHorizontalFlip="NO",
        ),
        "CollimatorShapeSequence": sequence_of(
            CollimatorShape="RECTANGULAR",
            CollimatorLeftVerticalEdge="0",
            CollimatorRightVerticalEdge=str(gantry.columns),
            CollimatorUpperHorizontalEdge="0",
            CollimatorLowerHorizontalEdge=str(gantry.rows),
        ),
        "IrradiationEventIdentificationSequence": sequence_of(
            IrradiationEventUID=study.uid("exposure", gantry.view.folder)
        ),
    }
    if not raw:
        groups["DerivationImageSequence"] = _derivation(gantry, study)
    return item_of(groups)


def _derivation(gantry: Gantry, study: StudyIdentity) -> Sequence:
    """That the picture for reading was made of the raw one."""
    purpose = code_item("121322", "DCM", "Source image for image processing operation")
    return sequence_of(
        DerivationDescription="Logarithm of exposure",
        DerivationCodeSequence=Sequence([code_item("LOG", "99MAMMOSIM", "Logarithm of exposure")]),
        SourceImageSequence=sequence_of(
            ReferencedSOPClassUID=SOP_CLASS["processing"],
            ReferencedSOPInstanceUID=study.uid("image", gantry.view.folder, KIND["processing"]),
            PurposeOfReferenceCodeSequence=Sequence([purpose]),
        ),
    )


def _image_type(intent: Intent) -> list[str]:
    return ["ORIGINAL" if intent == "processing" else "DERIVED", "PRIMARY", "TOMOSYNTHESIS", "NONE"]


def _frame(series: Tomosynthesis, index: int, settings: ExportSettings) -> Dataset:
    """Functional groups of one projection."""
    gantry, load = series.gantries[index], float(series.loads_mas[index])
    support = gantry.support_to_detector_mm
    to_support = float(gantry.focal_spot_mm[2])
    pivot_mm, turn = gantry.pivot_to_detector_mm, gantry.detector_turn
    # Unit vectors: places of pixels one millimetre apart.
    one = 1.0 / gantry.pixel_mm
    first, along_row, down_column = (
        _about_isocenter(gantry, row, column) for row, column in ((0, 0), (0, one), (one, 0))
    )
    part = load / series.mas * float(series.dose_factors[index]) / series.mean_dose_factor
    return item_of(
        {
            "FrameContentSequence": frame_content(
                settings, index + 1, index + 1, SECONDS_PER_PROJECTION
            ),
            "PositionerPositionSequence": sequence_of(
                PositionerPrimaryAngle=decimal_string(
                    positioner_angle_deg(gantry.view) + _turn(gantry)
                ),
                PositionerPrimaryAngleDirection="CC",
                PositionerSecondaryAngle="0",
            ),
            "XRayGeometrySequence": sequence_of(
                DistanceSourceToIsocenter=gantry.source_to_detector_mm
                - gantry.pivot_to_detector_mm,
                DistanceSourceToDetector=decimal_string(gantry.focal_spot_height_mm),
                DistanceSourceToPatient=decimal_string(to_support),
                EstimatedRadiographicMagnificationFactor=decimal_string(
                    (to_support + support) / to_support
                ),
            ),
            "IsocenterReferenceSystemSequence": sequence_of(
                XRaySourceIsocenterPrimaryAngle=_turn(gantry),
                XRaySourceIsocenterSecondaryAngle=0.0,
                BreastSupportIsocenterPrimaryAngle=0.0,
                BreastSupportIsocenterSecondaryAngle=0.0,
                BreastSupportXPositionToIsocenter=0.0,
                BreastSupportYPositionToIsocenter=0.0,
                BreastSupportZPositionToIsocenter=support - gantry.pivot_to_detector_mm,
                DetectorIsocenterPrimaryAngle=0.0 - gantry.detector_angle_deg,
                DetectorIsocenterSecondaryAngle=0.0,
                DetectorXPositionToIsocenter=pivot_mm * turn.sine,
                DetectorYPositionToIsocenter=0.0,
                DetectorZPositionToIsocenter=-pivot_mm * turn.cosine,
                DetectorActiveAreaTLHCPosition=_about_isocenter(gantry, -0.5, -0.5),
                DetectorActiveAreaOrientation=[
                    *(right - corner for right, corner in zip(along_row, first, strict=True)),
                    *(down - corner for down, corner in zip(down_column, first, strict=True)),
                ],
            ),
            "DetectorPositionSequence": sequence_of(
                DetectorPrimaryAngle="0",
                DetectorSecondaryAngle=decimal_string(_beam_towards_first_row_deg(gantry)),
            ),
            "XRayAcquisitionDoseSequence": sequence_of(
                KVP=decimal_string(series.middle.kvp),
                ExposureInmAs=load,
                ExposureTimeInms=1e3 * load / TUBE_CURRENT_MA,
                EntranceDoseInmGy=decimal_string(series.air_kerma_mgy * load / series.mas),
                HalfValueLayer=decimal_string(series.middle.hvl_mm_al),
                OrganDose=decimal_string(series.dose_mgy * part / 100.0),  # dGy
            ),
            "FrameDetectorParametersSequence": sequence_of(
                DetectorActiveTime="0", DetectorActivationOffsetFromExposure="0"
            ),
        }
    )


def _beam_towards_first_row_deg(gantry: Gantry) -> float:
    """Angle of the beam, as it travels, with the detector's normal: towards lower rows."""
    across = gantry.detector_angle_deg - gantry.tube_angle_deg  # towards +y
    return 0.0 + (across if gantry.view.laterality == "L" else -across)


def _about_isocenter(gantry: Gantry, row: float, column: float) -> list[float]:
    """Place of a pixel about the pivot, mm: x along the gantry's -y, y along its x, z up."""
    x_mm, y_mm, z_mm = gantry.detector_mm(row, column)
    pivot_z_mm = gantry.pivot_to_detector_mm - gantry.support_to_detector_mm
    return [gantry.focal_spot_y_mm - float(y_mm), float(x_mm), float(z_mm) - pivot_z_mm]


def _turn(gantry: Gantry) -> float:
    """Angle of the tube against the view's own, in the sense of Positioner Primary Angle.

    The sense is counter-clockwise as seen by someone who faces the equipment, so that of a left
    breast in MLO, whose tube stands over its medial side, is negative. The compression frame's +y,
    to which a positive tube angle turns, is the patient's left.
    """
    return -gantry.tube_angle_deg

"""Outlines and names of the lesions as a DICOM presentation state, for viewers that hide masks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from os import PathLike

import numpy as np
from contourpy import LineType, contour_generator
from highdicom import pr
from numpy.typing import NDArray
from pydicom import Dataset

from mammosim._version import VERSION
from mammosim.acquisition import Mammogram
from mammosim.export.derived_objects import place_in_study, settle
from mammosim.export.dicom import mammogram_dataset
from mammosim.export.dicom_object import long_string, save_object
from mammosim.export.identity import StudyIdentity
from mammosim.export.lesion_masks import LesionMask
from mammosim.export.settings import ExportSettings

GAP_PX = 12.0
"""Between a lesion's outline and its name, pixels."""


def write_presentation_state(
    masks: Sequence[LesionMask],
    mammogram: Mammogram,
    path: str | PathLike[str],
    study: StudyIdentity,
    settings: ExportSettings,
) -> None:
    """Write the lesions' outlines and names as a Grayscale Softcopy Presentation State.

    Parameters
    ----------
    masks : sequence of LesionMask
        At least one of them with a pixel; those without are left out.
    mammogram : Mammogram
    path : path
    study : StudyIdentity
    settings : ExportSettings

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    state = presentation_state_dataset(masks, mammogram, study, settings)
    save_object(state, path)


def presentation_state_dataset(
    masks: Sequence[LesionMask],
    mammogram: Mammogram,
    study: StudyIdentity,
    settings: ExportSettings,
) -> pr.GrayscaleSoftcopyPresentationState:
    """Make the presentation state; the parameters are `write_presentation_state`'s."""
    view = mammogram.gantry.view
    source = mammogram_dataset(mammogram, "presentation", study, settings)
    layer = pr.GraphicLayer("LESIONS", 1, "Simulated lesions")
    state = pr.GrayscaleSoftcopyPresentationState(
        referenced_images=[source],
        **place_in_study(study, "state", view),
        manufacturer_model_name="mammosim",
        software_versions=VERSION,
        device_serial_number="simulated",
        content_label="LESIONS",
        content_description="Outlines of the simulated lesions",
        graphic_layers=[layer],
        graphic_annotations=[
            _annotation(lesion, layer, source, study) for lesion in masks if lesion.mask.any()
        ],
        voi_lut_transformations=[
            pr.SoftcopyVOILUTTransformation(
                window_center=mammogram.window_center, window_width=mammogram.window_width
            )
        ],
    )
    settle(state, study, settings, "state", view, " lesion outlines")
    state.Laterality = view.laterality
    state.PresentationCreationDate = settings.date
    state.PresentationCreationTime = "000000"
    return state


def outlines(mask: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """Closed outlines of a mask, (n, 2) column and row each, whole numbers at pixel centres."""
    rows, columns = np.nonzero(mask.any(axis=1))[0], np.nonzero(mask.any(axis=0))[0]
    top, left = rows[0], columns[0]
    inside = np.pad(mask[top : rows[-1] + 1, left : columns[-1] + 1], 1).astype(np.float32)
    lines = contour_generator(z=inside, line_type=LineType.Separate).lines(0.5)
    for line in lines:
        yield np.asarray(line) + np.array([left - 1.0, top - 1.0])


def _annotation(
    lesion: LesionMask, layer: pr.GraphicLayer, source: Dataset, study: StudyIdentity
) -> pr.GraphicAnnotation:
    target = lesion.target
    named = {
        "tracking_id": long_string(f"{target.target_id} {target.name}"),
        "tracking_uid": study.uid("lesion", str(target.target_id)),
    }
    rows, columns = lesion.mask.shape
    # DICOM counts pixels from 1, their upper left corner being 0.5 (PS3.3 C.10.5.1). No coordinate
    # may exceed Columns and Rows, which the outline of a lesion cut by the image's edge would.
    lines = [np.minimum(line + 1.0, [columns, rows]) for line in outlines(lesion.mask)]
    graphics = [
        pr.GraphicObject(
            graphic_type=pr.GraphicTypeValues.POLYLINE, graphic_data=line, units="PIXEL", **named
        )
        for line in lines
    ]
    corner = np.concatenate(lines).max(axis=0)
    anchor = np.clip(corner + GAP_PX, 1.0, [columns, rows])
    text = pr.TextObject(
        text_value=long_string(target.name),
        units="PIXEL",
        anchor_point=(float(anchor[0]), float(anchor[1])),
        anchor_point_visible=False,
        **named,
    )
    return pr.GraphicAnnotation(
        referenced_images=[source],
        graphic_layer=layer,
        graphic_objects=graphics,
        text_objects=[text],
    )

"""The pictures of the report, hung as a radiologist hangs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim._derived import Derived
from mammosim._wording import counted
from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry, View
from mammosim.reconstruction import Reconstruction
from mammosim.report.convergence import convergence_svg
from mammosim.report.crop import Crop, common_crops
from mammosim.report.figures import picture_data_uri
from mammosim.report.labels import Label, Marked, place_labels, sampled
from mammosim.report.markers import Marker, markers
from mammosim.report.planes import SectionFrames, section_frames
from mammosim.report.realism import Finding, appearance_findings, realism
from mammosim.report.settings import ReportSettings
from mammosim.report.solid import moved_skin, plotly_gzip_base64
from mammosim.targets import Target

_VIEW_ORDER = ("CC", "MLO", "ML")
_BAR_MM = 20.0  # scale bar, at the breast support
_FONTS = 36.0  # sizes of the numbers' font in the height of a picture
_SMALL = 0.75  # of that size: the nipple's letter
_NAME_FONTS, _BAR_FONTS = (7.0, 2.2), 2.6  # room for the view's name, and height of the scale bar's

Skin = tuple[NDArray[np.float64], NDArray[np.float64]]
_curves: Derived[CompressedBreast, str] = Derived()
_sections: Derived[CompressedBreast, list[SectionFrames]] = Derived()
_skins: Derived[CompressedBreast, Skin] = Derived()


@dataclass(frozen=True, eq=False)
class ReportedView:
    """One view of a run, as far as it came.

    Parameters
    ----------
    compressed : CompressedBreast
    mammogram : Mammogram or None
        None where the run stopped before the exposure.
    reconstruction : Reconstruction or None
        Slices of a series of projections, where they were asked for.
    """

    compressed: CompressedBreast
    mammogram: Mammogram | None = None
    reconstruction: Reconstruction | None = None

    @property
    def convergence(self) -> str:
        """Drawing of the solver's history, SVG; empty if there is nothing to draw."""
        history, name = self.compressed.history, self.compressed.view.folder
        return _curves.of(self.compressed, partial(convergence_svg, history, name))

    @cached_property
    def findings(self) -> list[Finding]:
        """Its numbers beside published ones; none before the exposure."""
        return realism(self.compressed, self.mammogram) if self.mammogram else []

    @cached_property
    def appearance(self) -> dict[str, Finding]:
        """How its image looks, by key; nothing before the exposure."""
        if self.mammogram is None:
            return {}
        return appearance_findings(self.compressed.view.name, self.mammogram)

    @property
    def sections(self) -> list[SectionFrames]:
        """Its breast in three planes, at each step of its compression."""
        return _sections.of(self.compressed, partial(section_frames, self.compressed))

    @property
    def skin(self) -> Skin:
        """Points of the skin, and by how much compression moves them (`moved_skin`)."""
        return _skins.of(self.compressed, partial(moved_skin, self.compressed))

    def parts(self, settings: ReportSettings) -> tuple[Callable[[], Any], ...]:
        """What makes each part that the page has of this view alone; all take seconds together.

        Before the exposure, those of the compressed breast, which are kept as long as it is; after
        it, those of the image.
        """
        names = ["appearance", "findings"] if self.mammogram else ["convergence", "sections"]
        parts: list[Callable[[], Any]] = [partial(getattr, self, name) for name in names]
        if settings.three_d and not self.mammogram:
            parts += [partial(getattr, self, "skin"), plotly_gzip_base64]
        return tuple(parts)


@dataclass(frozen=True)
class Picture:
    """One view on the wall.

    Parameters
    ----------
    name : str
        Side and view, as `LCC`.
    side : {"L", "R"}
    technique : str
        Thickness, and where there is a mammogram its tube voltage, load and dose.
    alt : str
        What the picture shows, in words.
    uri : str
        The picture itself; empty where there is none.
    crop : Crop
        Which part of the image it shows.
    marks : list of (Marker, Label)
        In pixels of the whole image.
    outside : list of Target
        Targets that do not lie in the picture.
    two_cm_px : float
        Length of the scale bar: 2 cm at the breast support, as in Pixel Spacing.
    font_px : float
        Size of the numbers' font.
    """

    name: str
    side: str
    technique: str
    alt: str
    uri: str
    crop: Crop
    marks: list[tuple[Marker, Label]]
    outside: list[Target]
    two_cm_px: float
    font_px: float


def hanging_order(view: ReportedView) -> tuple[bool, int, int]:
    """CC above MLO above ML; right before left; views with a name of their own come last."""
    seen = view.compressed.view
    return bool(seen.title), _VIEW_ORDER.index(seen.name), "RL".index(seen.laterality)


def hanging(
    views: Sequence[ReportedView], targets: Sequence[Target], settings: ReportSettings
) -> list[dict[str, list[Picture]]]:
    """Hang the views as a radiologist does: right views on the left, chest walls together.

    Parameters
    ----------
    views : sequence of ReportedView
        In the order of the page.
    targets : sequence of Target
    settings : ReportSettings

    Returns
    -------
    list of dict
        One entry a row, with the pictures of its `right` and `left` half. Views of one breast
        alone share one row.
    """
    here = [targets_of(view.compressed.view, targets) for view in views]
    crops = _crops(views, here)
    pictures = [
        _picture(view, rows, crop, settings)
        for view, rows, crop in zip(views, here, crops, strict=True)
    ]
    if len({picture.side for picture in pictures}) < 2:
        return [{"single": pictures, "right": [], "left": []}] if pictures else []
    rows: list[dict[str, list[Picture]]] = []
    for name in dict.fromkeys(picture.name[1:] for picture in pictures):
        row = [picture for picture in pictures if picture.name[1:] == name]
        halves = {side: [picture for picture in row if picture.side == side] for side in "RL"}
        rows.append({"single": [], "right": halves["R"], "left": halves["L"]})
    return rows


def _crops(views: Sequence[ReportedView], here: Sequence[Sequence[Target]]) -> list[Crop]:
    """The part of each view's picture to show; an empty one where there is no picture."""
    exposed = [(view.mammogram, rows) for view, rows in zip(views, here, strict=True)]
    mammograms = [(mammogram, rows) for mammogram, rows in exposed if mammogram]
    marks = [markers(rows, mammogram.gantry) for mammogram, rows in mammograms]
    found = iter(common_crops([mammogram for mammogram, _ in mammograms], marks))
    return [next(found) if view.mammogram else Crop(0, 0, 0, 0) for view in views]


def hang_one(mammogram: Mammogram, settings: ReportSettings) -> Picture:
    """A mammogram by itself, without marks."""
    return _exposed(mammogram, (), common_crops([mammogram], [[]])[0], settings)


def _picture(
    view: ReportedView, here: Sequence[Target], crop: Crop, settings: ReportSettings
) -> Picture:
    if view.mammogram:
        return _exposed(view.mammogram, here, crop, settings)
    name, thickness = view.compressed.view.folder, f"{view.compressed.thickness_mm:.1f} mm"
    return Picture(name, name[0], thickness, "", "", crop, [], [], 0.0, 0.0)


def _exposed(
    mammogram: Mammogram, here: Sequence[Target], crop: Crop, settings: ReportSettings
) -> Picture:
    technique = [
        f"{mammogram.thickness_mm:.1f} mm",
        f"{mammogram.kvp:g} kV {mammogram.target}/{mammogram.filter}",
        f"{mammogram.mas:.0f} mAs",
        dose_text(mammogram),
    ]
    if "projections" in mammogram.measures:
        count = mammogram.measures["projections"]
        technique[2] += f", the middle one of {counted(count, 'projection')}"
    uri = picture_data_uri(mammogram, crop, settings.picture_rows)
    return framed(mammogram.gantry, here, crop, " · ".join(technique), uri)


def framed(gantry: Gantry, here: Sequence[Target], crop: Crop, technique: str, uri: str) -> Picture:
    """A picture with its marks and their labels, and the scale bar."""
    name = gantry.view.folder
    shown = [target.name for target in here if target.in_field and target.is_lesion]
    lesions = ", ".join(shown) or "no lesion"
    bar_px = _BAR_MM * gantry.magnification / gantry.pixel_mm
    marks = markers(here, gantry)
    return Picture(
        name=name,
        side=name[0],
        technique=technique,
        alt=f"Simulated mammogram {name}, showing {lesions}.",
        uri=uri,
        crop=crop,
        marks=list(zip(marks, _labels(marks, crop, name[0], bar_px), strict=True)),
        outside=[target for target in here if not target.in_field],
        two_cm_px=bar_px,
        font_px=crop.rows / _FONTS,
    )


def dose_text(mammogram: Mammogram) -> str:
    """Mean glandular dose; for a series, that of all its projections."""
    whole = mammogram.measures.get("dose_of_all_projections_mgy")
    if whole is None:
        return f"{mammogram.dose_mgy:.2f} mGy"
    return f"{whole:.2f} mGy in all"


def _labels(marks: Sequence[Marker], crop: Crop, side: str, bar_px: float) -> list[Label]:
    """Numbers of the marks: towards the nipple, where a breast has least, unless it is full."""
    font = crop.rows / _FONTS
    arrows = [((mark.from_x, mark.from_y), (mark.x, mark.y)) for mark in marks if mark.arrow]
    box = (float(crop.left), float(crop.top), float(crop.columns), float(crop.rows))
    towards = 1.0 if side == "L" else -1.0
    anterior = crop.left + crop.columns * (0.5 + 0.5 * towards)
    width, height = _NAME_FONTS[0] * font, _NAME_FONTS[1] * font
    bar = (1.1 * bar_px, _BAR_FONTS * font)
    corners = [
        (anterior - towards * 0.5 * width, crop.top + 0.5 * height, width, height),
        (anterior - towards * 0.5 * bar[0], crop.top + crop.rows - 0.5 * bar[1], *bar),
    ]
    return place_labels(
        Marked([[(mark.x, mark.y) for mark in marks]], [mark.filled for mark in marks], box,
               sampled(arrows, font), corners),
        [mark.text for mark in marks],
        [font * (_SMALL if mark.kind == "nipple" else 1.0) for mark in marks],
        (towards, 0.0),
    )  # fmt: skip


def targets_of(view: View, targets: Sequence[Target]) -> list[Target]:
    """Rows of one view.

    Parameters
    ----------
    view : View
    targets : sequence of Target
        Of any views, with the view's folder (``LCC``) or its label.

    Returns
    -------
    list of Target
        Those of the view; a target without a laterality belongs to both sides.
    """
    return [
        target
        for target in targets
        if target.view in (view.folder, view.label) and target.laterality in (view.laterality, "")
    ]

"""The report's page: complete, self-contained, and honest about what is missing."""

from __future__ import annotations

import base64
import dataclasses
import io
import itertools
import re
from functools import cache
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from make_records import HISTORY, make_compressed, make_gantry, make_mammogram, make_targets
from PIL import Image

from mammosim.geometry import View
from mammosim.report import ReportedView, ReportSettings, render_report, run_record
from mammosim.report.convergence import convergence_lines, convergence_svg
from mammosim.report.crop import Crop, common_crops
from mammosim.report.figures import picture_data_uri
from mammosim.report.glance import glance
from mammosim.report.hanging import hanging
from mammosim.report.markers import Marker, markers, shift_arrows
from mammosim.targets import LesionShiftResults

VOID = {"meta", "br", "link", "img", "hr", "input", "area", "base", "col", "embed", "source"}


class Page(HTMLParser):
    """Elements of a page; fails on tags that do not close in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.text += " " if tag in ("td", "th") else ""
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self._open):
            self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for found, attributes in self.elements if found == tag]

    @property
    def words(self) -> str:
        return " ".join(self.text.split())


@pytest.fixture(autouse=True)
def without_library(monkeypatch):
    """plotly.js is 2 MB that these tests would only read over; see test_report_shift.py."""
    monkeypatch.setattr("mammosim.report.lesion_shift.plotly_gzip_base64", lambda: "")


@pytest.fixture
def record(tmp_path):
    return run_record(
        tmp_path, status="done", seed=3, settings={}, stage_seconds={"compress": 1.5},
        warnings=["The side was assumed."], run_hash="ab" * 32,
    )  # fmt: skip


def views_of(*views: View, **changes) -> list[ReportedView]:
    return [ReportedView(make_compressed(view, **changes), make_mammogram(view)) for view in views]


@cache
def shared(*views: View) -> list[ReportedView]:
    """The same views for many tests, with what was computed of each before."""
    return views_of(*views)


def targets_of(*views: View):
    return [target for view in views for target in make_targets(view)]


LEFT = (View("CC", "L"), View("MLO", "L"))
BOTH = (View("MLO", "L"), View("CC", "L"), View("MLO", "R"), View("CC", "R"))


def test_the_page_is_well_formed_and_loads_nothing(record):
    page = Page(render_report(shared(*LEFT), targets_of(*LEFT), record, title="quickstart"))
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"link", "iframe", "object", "base"}
    assert not any("src" in script for script in page.all("script"))
    (policy,) = (meta["content"] for meta in page.all("meta") if "http-equiv" in meta)
    assert policy.startswith("default-src 'none'")  # browsers refuse whatever slips through
    for tag, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "srcset", "data"):
            value = attributes.get(name, "#")
            loaded_from_elsewhere = not value.startswith(("#", "data:image/"))
            assert not loaded_from_elsewhere or tag == "a", (tag, value)
    for style in re.findall(r"url\(([^)]*)\)", render_report(shared(*LEFT), [], record)):
        assert style.startswith("#")


def test_headings_are_in_order_and_every_picture_has_words(record):
    page = Page(render_report(shared(*LEFT), targets_of(*LEFT), record))
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    named = [a["aria-label"] for tag, a in page.elements if a.get("role") == "img"]
    assert sum(label.startswith("Simulated mammogram") for label in named) == 2
    assert "showing mass 1, calcs, clip A" in named[0]
    assert page.all("html")[0]["lang"] == "en"


def test_the_case_is_told_in_one_line(record):
    text = Page(render_report(shared(*LEFT), targets_of(*LEFT), record)).words
    assert "Left breast, CC and MLO" in text
    assert (
        "hemisphere.nii.gz · compressed to LCC 52.0 mm, LMLO 52.0 mm · W/Rh 28 kV · 3 lesions"
    ) in text


def test_views_hang_right_before_left_and_cc_before_mlo(record):
    page = Page(render_report(shared(*BOTH), targets_of(*BOTH), record))
    shown = re.findall(r"Simulated mammogram (\w+)", str(page.elements))
    assert shown == ["RCC", "LCC", "RMLO", "LMLO"]
    assert "Both breasts, CC and MLO" in page.words
    assert "6 lesions" in page.words


def test_each_lesion_is_marked_where_its_target_projects():
    for view in BOTH:
        gantry = make_gantry(view)
        targets = make_targets(view)
        marks = {mark.name: mark for mark in markers(targets, gantry)}
        assert set(marks) == {"mass 1", "calcs", "clip A", "nipple"}  # the landmark is outside
        for target in targets[:3]:
            mark = marks[target.name]
            # SVG counts from the first pixel's corner, the table from its centre.
            assert (mark.x - 0.5, mark.y - 0.5) == (target.image_col_px, target.image_row_px)
            assert mark.text == str(target.target_id)
            assert 2.0 * mark.radius * gantry.pixel_mm > target.extent_mm


def test_marks_are_in_the_page_at_those_places(record):
    view = LEFT[0]
    page = Page(render_report(views_of(view), make_targets(view), record))
    circles = [(float(c["cx"]), float(c["cy"])) for c in page.all("circle") if "cx" in c]
    for target in make_targets(view)[:3]:
        at = (target.image_col_px + 0.5, target.image_row_px + 0.5)
        # One decimal is written.
        assert any(np.hypot(x - at[0], y - at[1]) < 0.08 for x, y in circles)


def numbers_of(view, targets):
    """The numbers of a view's picture, by the target's name."""
    (row,) = hanging(views_of(view), targets, ReportSettings())
    return {mark.name: label for mark, label in row["single"][0].marks}


def test_a_number_stands_towards_the_nipple_unless_the_picture_ends_there():
    for view, towards in ((View("CC", "L"), 1.0), (View("CC", "R"), -1.0)):
        mass, calcs = make_targets(view)[:2]
        assert numbers_of(view, [calcs])["calcs"].x * towards > 0.0
        edge = 118.0 if towards > 0.0 else 1.0
        at_edge = dataclasses.replace(mass, image_col_px=edge)
        assert numbers_of(view, [at_edge])["mass 1"].x * towards <= 0.0


def test_the_lesion_table_says_where_and_how_far(record):
    text = Page(render_report(shared(*LEFT), targets_of(*LEFT), record)).words
    assert "1 mass 1 Mass 12.0 14.0 1:30 21.5 9.2 5.1 24.1 5.1 24.1" in text
    # The ball of the grains' volume says nothing of a group: its extent does.
    assert "2 calcs Calcifications – 8.0 1:30" in text
    assert "4 axillary tail Landmark – – 1:30 21.5 9.2 5.1 not in picture" in text
    assert "Not in this picture: 4 axillary tail" in text


def test_the_frontal_drawing_faces_the_patient():
    """The patient's left is the viewer's right; superior is up, which is negative in SVG."""
    view = View("CC", "L")
    target = dataclasses.replace(
        make_targets(view)[0], y_mm=30.0, z_mm=40.0, shift_y_mm=1.0, shift_z_mm=5.0
    )
    drawing = shift_arrows({"LCC": [target]}, np.array([40.0, 10.0, 10.0]))
    assert drawing["dots"] == [(1, "mass 1", 20.0, -30.0)]
    assert drawing["arrows"] == [(0, "LCC", 20.0, -30.0, 1.0, -5.0)]
    assert drawing["rings"] == [20.0, 40.0, 60.0]  # the arrow ends at hypot(21, 35) = 40.8


def test_compression_and_exposure_are_in_units_a_radiologist_reads(record):
    text = Page(render_report(views_of(LEFT[0]), [], record)).words
    assert "Compressed thickness 52.0 mm" in text
    assert "Force on the paddle 91.3 N" in text
    assert "Contact area 81.23 cm²" in text
    assert "Volume before 134 mL" in text
    assert "Inverted cells 3" in text
    assert "Mean glandular dose 1.46 mGy" in text
    assert "Density 17.3 %" in text


def test_a_muscle_that_was_set_back_for_a_view_is_told_of(record):
    craniocaudal, oblique = views_of(*LEFT)
    held = dataclasses.replace(craniocaudal.compressed.phantom, muscle_standing=0.6)
    set_back = ReportedView(
        dataclasses.replace(craniocaudal.compressed, phantom=held), craniocaudal.mammogram
    )
    name = "Muscle's distance from the chest wall"
    text = Page(render_report([set_back, oblique], [], record)).words
    assert f"{name} 0.6 of that in oblique views (assumed) as in the phantom" in text
    assert name not in Page(render_report([craniocaudal, oblique], [], record)).words


def test_warnings_are_all_shown_and_each_once(record):
    views = views_of(*LEFT, notes=("Three cells inverted.", "The side was assumed."))
    text = Page(render_report(views, [], record)).words
    assert "Notes" in text
    assert text.index("Mammograms") < text.index("Notes")
    assert text.count("The side was assumed.") == 1
    assert text.count("Three cells inverted.") == 1


@pytest.mark.parametrize(
    ("status", "said"),
    [("not converged", "This run did not converge"), ("interrupted", "This run was interrupted")],
)
def test_a_run_that_is_not_done_says_so_before_anything_else(record, status, said):
    text = Page(render_report(shared(*LEFT), [], record | {"status": status})).words
    assert said in text
    assert text.index(said) < text.index("Mammograms")
    assert said not in Page(render_report(shared(*LEFT), [], record)).words


def test_a_view_without_image_is_reported_as_far_as_it_came(record):
    views = [ReportedView(make_compressed(LEFT[0], converged=False))]
    text = Page(render_report(views, [], record | {"status": "not converged"})).words
    assert "LCC: no image was made." in text
    assert "Converged no" in text
    assert "Exposure and dose" not in text


def test_an_empty_run_still_has_a_page(record):
    text = Page(render_report([], [], record | {"status": "interrupted"})).words
    assert "No view was computed." in text
    assert "No image was made." in text
    assert "no lesions and no landmarks" in text


def test_missing_numbers_are_dashes(record):
    compressed = make_compressed(LEFT[0])
    measures = dict(compressed.measures) | {"force_n": float("nan")}
    view = ReportedView(dataclasses.replace(compressed, measures=measures))
    text = Page(render_report([view], [], record)).words
    assert "Force on the paddle – N" in text
    assert "nan" not in text


def views_scripts(record):
    return Page(render_report(views_of(LEFT[0]), [], record)).all("script")


def test_names_cannot_break_the_page(record):
    nasty = "<script>alert(\"x\")</script> & 'co'"
    targets = [dataclasses.replace(target, name=nasty) for target in make_targets(LEFT[0])]
    page = Page(render_report(views_of(LEFT[0]), targets, record, title=nasty))
    assert len(page.all("script")) == len(views_scripts(record))
    assert nasty in page.text


def test_the_settings_are_there_to_be_unfolded(record):
    page = Page(render_report([], [], record | {"settings": {"compression": {"force_n": 90.5}}}))
    assert len(page.all("details")) == 1
    assert '"force_n": 90.5' in page.text


def test_versions_times_and_references_are_told(record):
    page = Page(render_report(views_of(LEFT[0]), [], record))
    assert f"numpy {np.__version__}" in page.words
    assert "compress 1.5 s" in page.words
    assert "Seed 3" in page.words
    links = [a["href"] for a in page.all("a")]
    assert "https://doi.org/10.1016/j.ejmp.2020.04.026" in links


def test_the_page_is_the_same_every_time(record):
    pages = {render_report(views_of(*LEFT), targets_of(*LEFT), record) for _ in range(2)}
    assert len(pages) == 1


def picture(uri: str) -> np.ndarray:
    head, data = uri.split(",", 1)
    assert head == "data:image/jpeg;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))


def test_the_picture_is_reduced_by_whole_factors_and_windowed():
    mammogram = make_mammogram(LEFT[0])
    flat = dataclasses.replace(
        mammogram,
        for_presentation=np.repeat([[0], [100], [200]], 4, axis=0).repeat(12, axis=1),
        window_center=100.5,
        window_width=201.0,
    )
    everything = Crop(0, 0, 12, 12)
    whole, half = (picture(picture_data_uri(flat, everything, rows)) for rows in (100, 6))
    assert whole.shape == (12, 12)
    assert half.shape == (6, 6)
    # JPEG is not exact; at this quality it keeps flat areas within a few grey levels.
    np.testing.assert_allclose(half[[0, 5], 0], [0, 255], atol=6)
    np.testing.assert_allclose(whole[[0, 11], 0], [0, 255], atol=6)
    lowest = picture(picture_data_uri(flat, Crop(8, 2, 4, 5), 100))
    assert lowest.shape == (4, 5)
    assert lowest.min() > 240


def test_a_reduced_picture_covers_what_the_whole_one_does():
    """13 rows by a factor of 2: the last row is kept, repeated."""
    mammogram = make_mammogram(LEFT[0])
    odd = dataclasses.replace(mammogram, for_presentation=np.zeros((13, 9), np.uint16))
    assert picture(picture_data_uri(odd, Crop(0, 0, 13, 9), 6)).shape == (7, 5)


def in_air(view: View, rows: slice, columns: slice):
    """A picture of 240 x 120 pixels of half a millimetre that is air but for a rectangle."""
    pixels = np.zeros((240, 120), np.uint16)
    pixels[rows, columns] = 1000
    return dataclasses.replace(make_mammogram(view), for_presentation=pixels)


def test_views_are_cropped_to_one_size_around_the_breast():
    left = in_air(View("CC", "L"), slice(100, 140), slice(0, 30))
    right = in_air(View("CC", "R"), slice(60, 120), slice(100, 120))
    crops = common_crops([left, right], [[], []])
    # The larger of 20 and 30 mm and twice 15 mm of margin, 15 mm and one margin: 2 pixels a mm.
    assert crops == [Crop(60, 0, 120, 60), Crop(30, 60, 120, 60)]


def test_a_magnified_view_does_not_change_the_crop_of_the_others():
    contact = in_air(View("CC", "R"), slice(100, 140), slice(90, 120))
    large = in_air(View("CC", "R", title="CC_mag"), slice(20, 200), slice(20, 120))
    gantry = dataclasses.replace(large.gantry, support_to_detector_mm=285.0)
    magnified = dataclasses.replace(large, gantry=gantry)
    alone = common_crops([contact], [[]]) + common_crops([magnified], [[]])
    assert common_crops([contact, magnified], [[], []]) == alone
    compressed = make_compressed(View("CC", "R"))
    views = [ReportedView(compressed, mammogram) for mammogram in (contact, magnified)]
    ((first, second),) = [row["single"] for row in hanging(views, [], ReportSettings())]
    # 2 cm in the breast: 650/365 against 650/635 times as long on the detector.
    assert second.two_cm_px / first.two_cm_px == pytest.approx(635.0 / 365.0)


def test_a_crop_keeps_within_the_image_and_marks_within_the_crop():
    view = View("CC", "L")
    high = in_air(view, slice(0, 40), slice(0, 30))
    assert common_crops([high], [[]]) == [Crop(0, 0, 100, 60)]
    mark = Marker("1", "far", "mass", x=80.0, y=200.0, radius=5.0)
    (crop,) = common_crops([high], [[mark]])
    assert crop.top <= 200 < crop.top + crop.rows
    assert crop.left <= 80 < crop.left + crop.columns
    empty = in_air(view, slice(0, 0), slice(0, 0))
    assert common_crops([empty], [[]]) == [Crop(0, 0, 240, 120)]


def test_the_settings_reduce_the_page(record):
    sizes = [
        len(render_report(shared(*LEFT), [], record, ReportSettings(picture_rows=rows)))
        for rows in (120, 240)
    ]
    assert sizes[0] < sizes[1]


def test_the_convergence_curve_is_svg_in_the_pages_colour():
    svg = convergence_svg(HISTORY, "LCC")
    root = ElementTree.fromstring(svg)
    assert root.tag.endswith("svg")
    assert "currentColor" in svg
    assert "residual" in svg
    assert "mean move mm" in svg
    assert "settled" not in svg
    assert svg == convergence_svg(HISTORY, "LCC")


def test_a_column_of_words_makes_a_line_of_each():
    rows = [(0, "x", 0.5), (1, "z", 0.1), (2, "x", 0.2)]
    history = np.array(rows, dtype=[("iteration", "i4"), ("axis", "U1"), ("error_voxel", "f8")])
    svg = convergence_svg(history, "LCC")
    assert "error voxel x" in svg
    assert "error voxel z" in svg


def test_an_error_that_is_not_known_yet_is_left_out_of_the_curve():
    known = np.array([(0, 0.5), (1, 0.1)], dtype=[("iteration", "i4"), ("error_mm", "f8")])
    history = np.concatenate([known[:1], known])
    history["error_mm"][0] = np.inf
    (line,) = convergence_lines(history)
    assert line.rows.tolist() == [2, 3]
    assert "error mm" in convergence_svg(history, "LCC")


@pytest.mark.parametrize(
    "history",
    [
        np.zeros(0, dtype=[("iteration", "i4"), ("residual", "f8")]),
        np.zeros(3, dtype=[("iteration", "i4"), ("residual", "f8")]),
        np.zeros(3, dtype=[("iteration", "i4")]),
    ],
)
def test_without_anything_to_draw_there_is_no_curve(history):
    assert convergence_svg(history, "LCC") == ""


def with_error(view: View, **measures: float) -> ReportedView:
    """A view whose solver told how far it is from equilibrium."""
    compressed = make_compressed(view)
    told = dict(compressed.measures) | measures
    return ReportedView(dataclasses.replace(compressed, measures=told), make_mammogram(view))


def test_the_first_things_said_are_shift_thickness_dose_and_how_sure():
    view = with_error(LEFT[0], error_mm=0.004, largest_error_mm=0.123)
    found = glance([view], make_targets(LEFT[0]), LesionShiftResults())
    assert [line.name for line in found.moved] == ["1 mass 1", "2 calcs", "3 clip A"]
    assert found.moved[0].text == f"LCC {make_targets(LEFT[0])[0].shift_mm:.0f} mm"
    assert [(line.name, line.text) for line in found.dose] == [
        ("LCC", "52.0 mm thick, 91 N, 1.46 mGy")
    ]
    assert found.sure[0].text == "at most 0.12 mm from equilibrium"
    assert found.sure[1].text.startswith("not computed; targets.uncertainty")


@pytest.mark.parametrize(
    ("off_mm", "said"), [(0.583, "about 0.6 mm"), (0.04, "less than 0.1 mm"), (None, "")]
)
def test_how_far_plates_are_from_balance_is_said_with_how_sure(off_mm, said):
    measures = {} if off_mm is None else {"height_error_mm": off_mm}
    view = with_error(LEFT[0], error_mm=0.004, largest_error_mm=0.123, **measures)
    text = glance([view], [], LesionShiftResults()).sure[0].text
    wanted = f"; plates {said} off balance" if said else ""
    assert text == "at most 0.12 mm from equilibrium" + wanted


def test_what_did_not_converge_or_was_not_exposed_is_said_first():
    view = ReportedView(make_compressed(LEFT[0], converged=False))
    found = glance([view], [], LesionShiftResults())
    assert found.dose[0].text.endswith("no image was made")
    assert found.sure[0].text == "did not converge: do not rely on it"


def test_many_lesions_are_counted_after_the_first_ones(record):
    mass = make_targets(LEFT[0])[0]
    many = [dataclasses.replace(mass, target_id=number) for number in range(1, 10)]
    assert glance(views_of(LEFT[0]), many, LesionShiftResults()).more == 3
    text = Page(render_report(views_of(LEFT[0]), many, record)).words
    assert "3 more in the table" in text


def test_ids_differ_all_over_the_page(record):
    page = Page(render_report(shared(*BOTH), targets_of(*BOTH), record))
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    referred = [a["href"][1:] for _, a in page.elements if a.get("href", "").startswith("#")]
    assert referred
    assert set(referred) <= set(ids)

"""The shift on the page: drawings, 3-D surface, tables; and all of it in a real browser."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import html
import io
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from make_records import (
    RADIUS_MM,
    make_compressed,
    make_gantry,
    make_mammogram,
    make_phantom,
    make_targets,
)
from PIL import Image

from mammosim.geometry import View
from mammosim.report import ReportedView, ReportSettings, render_report, run_record
from mammosim.report.markers import markers
from mammosim.report.planes import FRAMES, drawings, section_frames
from mammosim.report.sections import PIXEL_MM, PLANES, Box, interpolated_field, section
from mammosim.report.solid import moved_skin, plotly_gzip_base64, skin_surface, solid
from mammosim.targets import BiopsyResult, LesionShiftResults, RuleError, ShiftUncertainty

CC, MLO = View("CC", "L"), View("MLO", "L")
FLAT = ReportSettings(three_d=False)


@pytest.fixture
def record(tmp_path):
    return run_record(tmp_path, status="done", seed=3, settings={}, stage_seconds={})


def page(record, settings=FLAT, answers=None):
    views = [ReportedView(make_compressed(view), make_mammogram(view)) for view in (CC, MLO)]
    targets = [*make_targets(CC), *make_targets(MLO)]
    return render_report(views, targets, record, settings, "quickstart", answers)


def picture(uri):
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))), float)


def test_directions_are_those_of_a_radiologist():
    left, front, up = np.eye(3)[[1, 0, 2]]
    frontal, sagittal, transverse = PLANES
    assert frontal.project(left).tolist() == [1.0, 0.0]
    assert frontal.project(up).tolist() == [0.0, -1.0]  # SVG counts downwards
    assert sagittal.project(front).tolist() == [-1.0, 0.0]
    assert sagittal.project(up).tolist() == [0.0, -1.0]
    assert transverse.project(left).tolist() == [1.0, 0.0]
    assert transverse.project(front).tolist() == [0.0, -1.0]


def test_drawings_show_the_breast_before_and_after():
    """A hemisphere of 40 mm radius whose height is pressed to 52 mm."""
    frontal, sagittal, _ = drawings(section_frames(make_compressed(CC)), make_targets(CC))
    assert len(frontal.frames) == FRAMES
    first, last = picture(frontal.frames[0]), picture(frontal.frames[-1])
    assert first.shape == last.shape == (
        round(frontal.height / PIXEL_MM), round(frontal.width / PIXEL_MM)
    )  # fmt: skip
    spans = [np.ptp(np.flatnonzero((image > 40).any(axis=1))) * PIXEL_MM for image in (first, last)]
    # The plane goes with the first lesion; voxels of 2 mm, a lattice of 4 mm.
    across = 2.0 * np.sqrt(RADIUS_MM**2 - make_targets(CC)[0].x_mm ** 2)
    assert spans[0] == pytest.approx(across, abs=4.0)
    assert spans[1] == pytest.approx(across * 52.0 / (2 * RADIUS_MM), abs=6.0)
    widths = [
        np.ptp(np.flatnonzero((image > 40).any(axis=0))) * PIXEL_MM for image in (first, last)
    ]
    assert widths[1] / widths[0] == pytest.approx(1.1, abs=0.06)
    assert sagittal.targets[0].label.text == "1"


def test_targets_are_drawn_where_the_table_has_them():
    targets = make_targets(CC)
    for drawing in drawings(section_frames(make_compressed(CC)), targets):
        for target, moved in zip(targets, drawing.targets, strict=True):
            here = drawing.plane.project(target.place_mm)
            there = drawing.plane.project(target.place_mm + target.shift_vector_mm)
            assert (moved.x, moved.y) == pytest.approx(tuple(here))
            assert (moved.to_x, moved.to_y) == pytest.approx(tuple(there))
    assert drawing.targets[-1].label.text == "N"


def test_a_section_is_one_plane_of_the_breast():
    """Whatever lies in front of the plane or behind it does not show."""
    phantom = make_phantom("L")
    box = Box(-50.0, -50.0, 100.0, 100.0)
    through = np.array([5.0, 10.0, -6.0])
    for plane, normal in zip(PLANES, np.eye(3), strict=True):
        beyond = phantom.frame.position_mm(np.stack(np.indices(phantom.labels.shape), axis=-1))
        away = np.abs((beyond - through) @ normal) > 2.0
        altered = dataclasses.replace(phantom, labels=np.where(away, 29, phantom.labels))
        seen = section(phantom, plane, through, box)
        np.testing.assert_array_equal(section(altered, plane, through, box), seen)
        assert len(np.unique(seen)) > 2  # air, fat, gland


def test_a_section_shows_each_tissue_where_it_came_to_lie():
    """A homogeneous stretch: the compressed section is the uncompressed one, stretched."""
    compressed = make_compressed(CC)
    stretch = np.array([1.15, 1.1, 52.0 / (2 * RADIUS_MM)])
    middle = np.zeros(3)
    frontal = PLANES[0]
    before = Box(-40.0, -40.0, 80.0, 80.0)
    at = before.centres_mm.reshape(-1, 2)
    inside = np.linalg.norm(at, axis=1) < 0.8 * RADIUS_MM  # away from the lattice's rim
    grey = section(compressed.phantom, frontal, middle, before).ravel()
    for share in (0.5, 1.0):
        way = 1.0 + share * (stretch - 1.0)
        wide = Box(-60.0, -60.0, 120.0, 120.0)
        field = interpolated_field(compressed.field, share)
        moved = section(compressed.phantom, frontal, middle, wide, field)
        row = np.floor(at[:, 1] * way[2] + 60.0).astype(int)
        column = np.floor(at[:, 0] * way[1] + 60.0).astype(int)
        same = moved[row, column] == grey
        assert same[inside].mean() > 0.93  # all but pixels at borders of tissues


def test_gland_is_brighter_than_fat_and_lesions_are_white():
    compressed = make_compressed(CC)
    phantom = compressed.phantom
    mass = phantom.lesions[0]
    frontal = PLANES[0]
    image = section(phantom, frontal, mass.position_mm, Box(-50.0, -50.0, 100.0, 100.0))
    place = frontal.project(mass.position_mm) + 50.0
    assert image[int(place[1]), int(place[0])] == 255
    assert {0, round(0.32 * 255), round(0.75 * 255), 255} >= set(np.unique(image).tolist())


def test_the_surface_is_the_skin():
    surface = skin_surface(make_phantom("L"))
    # Voxels of 2 mm and steps of half a millimetre, about a middle that may lie between two.
    np.testing.assert_allclose(np.linalg.norm(surface[:-1], axis=-1), RADIUS_MM, atol=3.0)
    assert surface[-1, :, 0].min() == pytest.approx(RADIUS_MM, abs=2.0)
    np.testing.assert_allclose(surface[:, 0], surface[:, -1], atol=1e-9)


def test_the_3d_view_moves_by_the_field():
    compressed, targets = make_compressed(CC), make_targets(CC)
    drawn = solid(moved_skin(compressed), targets)
    skin = np.stack([np.array(axis) for axis in drawn["skin"]], axis=-1)
    shift = np.stack([np.array(axis) for axis in drawn["skin_shift"]], axis=-1)
    expected = compressed.displacement_at(skin.reshape(-1, 3)).reshape(skin.shape)
    np.testing.assert_allclose(shift, expected, atol=0.1)  # a tenth is written
    assert [target["name"] for target in drawn["targets"]] == [row.name for row in targets]
    assert drawn["targets"][0]["shift"] == targets[0].shift_vector_mm.tolist()


def test_the_library_is_packed_whole_and_can_be_left_out(record):
    source = gzip.decompress(base64.b64decode(plotly_gzip_base64()))
    assert b"plotly.js v" in source[:200]
    assert b"MIT license" in source[:200]
    with_it, without = page(record, ReportSettings()), page(record)
    assert plotly_gzip_base64() in with_it
    assert "solid-show" not in html.unescape(without).split("<script")[0]
    assert len(without) < 1_000_000 < len(with_it) < 4_000_000


def test_arrows_start_where_uncompressed_tissue_would_have_appeared(record):
    gantry = make_gantry(CC)
    target = make_targets(CC)[0]
    far = dataclasses.replace(
        target, image_row_px=target.image_row_px + 40.0, image_col_px=target.image_col_px
    )
    near, moved = markers([target, far], gantry)
    row, column = gantry.project(gantry.gantry_from_breast(target.place_mm))
    assert (near.from_x, near.from_y) == pytest.approx((column + 0.5, row + 0.5))
    assert moved.arrow
    assert not near.arrow  # 5 mm, inside its own circle
    text = page(record)
    assert 'class="from"' not in text.split("Circles: lesions")[0]


def answers():
    rules = (RuleError(1, "mass 1", "mass", "CC", "MLO", 21.5, 24.1, 30.3, 6.2, 20.0, 23.4, 3.4),)
    needle = BiopsyResult(
        1, "mass 1", "mass", "CC", "ML", 44.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0,
        13.93, 11.1, -8.4, True, 5.5, 6.6, 8.59, 12.3,
    )  # fmt: skip
    air = dataclasses.replace(needle, name="far", aim_in_breast=False, clip_from_lesion_mm=np.nan)
    unseen = dataclasses.replace(
        air, name="lost", miss_mm=np.nan, needle_miss_mm=np.nan, depth_error_mm=np.nan
    )
    none = dataclasses.replace(needle, biopsy_view="none", biopsy_thickness_mm=np.nan)
    spread = ShiftUncertainty(
        1, "mass 1", "mass", "CC", 50, 3.0, 1.0, -4.0, *[0.1] * 6, 6.1, 1, 0, 0, 4.2, 0, 1, 0, 2.3,
        0, 0, 1, 7.7, 1.0, 9.9, 1.0, 1.0, 1.0,
    )  # fmt: skip
    lying = dataclasses.replace(none, name="lying", biopsy_view="supine")
    alone = dataclasses.replace(lying, target_id=2, name="alone")
    place = dataclasses.replace(spread, view="CC supine", samples=48, long_mm=5.1)
    return LesionShiftResults(rules, (needle, air, unseen, none, lying, alone), (spread, place))


def test_the_answers_are_in_tables(record):
    words = " ".join(re.sub(r"<[^>]*>", " ", page(record, answers=answers())).split())
    assert "mass 1 CC MLO 21.5 24.1 30.3 6.2 20.0 23.4 3.4" in words
    assert "mass 1 CC ML, 44.0 mm 13.9 11.1 -8.4 5.5 6.6 8.6 12.3" in words
    assert "aim is in air" in words
    assert "lost CC ML, 44.0 mm – – –" in words
    assert "CC no plates" in words
    assert "Without plates, the woman supine (experimental)" in words
    assert "1 lying CC 1.0 2.0 3.0 48 5.1 4.2 2.3" in words
    assert "2 alone CC 1.0 2.0 3.0 not asked for" in words
    assert "mass 1 CC 50 3.0 1.0 -4.0 6.1 4.2 2.3 7.7 9.9" in words
    without = page(record)
    for heading in ("At biopsy", "How sure it is", "From one picture to the other", "experimental"):
        assert heading not in without


# In a browser. Debian's package is `chromium`; where there is none the tests say so.

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def needs_chromium(test):
    """Leave a test to `.ci/services`, and skip it there where there is no browser."""
    reason = "no Chromium to open the page with"
    return pytest.mark.service(pytest.mark.skipif(CHROMIUM is None, reason=reason)(test))


LISTEN = """<head><script>
const seen = {errors: [], loaded: []};
window.addEventListener("error", (e) => seen.errors.push(e.message));
window.addEventListener("unhandledrejection", (e) => seen.errors.push(String(e.reason)));
document.addEventListener("securitypolicyviolation", (e) => seen.errors.push(e.blockedURI));
</script>"""

PROBE = """<script>
window.addEventListener("load", async () => {
  const dots = () => [...document.querySelectorAll("#shift-planes circle")]
    .map((dot) => [Number(dot.getAttribute("cx")), Number(dot.getAttribute("cy"))]);
  const frames = () => [...document.querySelectorAll("#shift-planes image")]
    .map((image) => image.getAttribute("href"));
  const slider = document.getElementById("shift-slider");
  const at = {};
  for (const value of [0, 50, 100]) {
    slider.value = value;
    slider.dispatchEvent(new Event("input"));
    at[value] = {dots: dots(), frames: frames(),
      said: document.getElementById("shift-said").textContent};
  }
  seen.at = at;
  seen.named = [...document.querySelectorAll(".view .mark title")].map((t) => t.textContent);
  seen.planes = [...document.querySelectorAll("#shift-planes g title")].map((t) => t.textContent);
  const view = document.getElementById("shift-view");
  view.value = "LMLO";
  view.dispatchEvent(new Event("change"));
  seen.other = frames();
  slider.focus();
  seen.focus = document.activeElement.id;
  const show = document.getElementById("solid-show");
  if (show) {
    show.click();
    const said = document.getElementById("solid-said");
    for (let n = 0; n < 90 && !/Drag|cannot/.test(said.textContent); n++) {
      await new Promise((done) => setTimeout(done, 50));
    }
    seen.solid = said.textContent;
    const turn = document.querySelector("[data-turn='15,0']");
    const plot = document.getElementById("solid-plot");
    const eye = () => JSON.stringify(plot.layout?.scene.camera.eye);
    const before = eye();
    turn.click();
    await new Promise((done) => setTimeout(done, 200));
    seen.turned = before !== eye();
  }
  seen.loaded = performance.getEntriesByType("resource").map((entry) => entry.name)
    .filter((name) => !/^(data|blob):/.test(name));
  const told = document.createElement("pre");
  told.id = "probe";
  told.textContent = JSON.stringify(seen);
  document.body.append(told);
});
</script></body>"""


def opened(text, folder):
    """What the probe saw of a page in headless Chromium, without any network.

    Time is virtual: what is not computing goes by at once. Each virtual second of a 3-D view is 60
    pictures drawn without a graphics card, so there are few of them, of a small window.
    """
    file = folder / "report.html"
    text = text.replace("<head>", LISTEN, 1).replace("</body>", PROBE)
    file.write_text(text, encoding="utf-8")
    options = [
        "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}",
        "--window-size=500,400", "--virtual-time-budget=6000", "--dump-dom",
    ]  # fmt: skip
    done = subprocess.run(
        [str(CHROMIUM), *options, file.as_uri()], capture_output=True, text=True, timeout=300,
        check=True,
    )  # fmt: skip
    found = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert found, done.stdout[-2000:] + done.stderr[-2000:]
    return json.loads(html.unescape(found[1]))


@needs_chromium
def test_the_probe_notices_errors_and_requests(record, tmp_path):
    """Else the tests below could not fail."""
    more = "</main><img src='http://example.org/a.png'><script>no()</script>"
    broken = page(record).replace("</main>", more)
    errors = opened(broken, tmp_path)["errors"]
    assert any("example.org" in error for error in errors)
    assert any("no is not defined" in error for error in errors)


@needs_chromium
def test_a_browser_opens_the_page_without_error_or_network(record, tmp_path):
    seen = opened(page(record, answers=answers()), tmp_path)
    assert seen["errors"] == []
    assert seen["loaded"] == []
    assert seen["focus"] == "shift-slider"


@needs_chromium
def test_the_slider_moves_and_every_lesion_is_on_the_pictures(record, tmp_path):
    seen = opened(page(record), tmp_path)
    start, half, end = (seen["at"][value] for value in ("0", "50", "100"))
    assert (start["said"], half["said"], end["said"]) == (
        "uncompressed", "50 % of the way", "compressed",
    )  # fmt: skip
    assert len({tuple(state["frames"]) for state in (start, half, end)}) == 3
    drawn = drawings(section_frames(make_compressed(CC)), make_targets(CC))
    np.testing.assert_allclose(
        start["dots"], [(t.x, t.y) for d in drawn for t in d.targets], atol=0.01
    )
    np.testing.assert_allclose(
        end["dots"], [(t.to_x, t.to_y) for d in drawn for t in d.targets], atol=0.01
    )
    np.testing.assert_allclose(
        half["dots"], np.mean([start["dots"], end["dots"]], axis=0), atol=0.01
    )
    assert seen["other"] != end["frames"]
    for target in make_targets(CC):
        number = "N" if target.kind == "nipple" else str(target.target_id)
        assert seen["planes"].count(f"{number}: {target.name}") == 3
        if target.in_field:
            assert seen["named"].count(f"{number}: {target.name}") == 2  # CC and MLO


@needs_chromium
def test_the_3d_view_is_drawn_and_turned_or_says_why_not(record, tmp_path):
    seen = opened(page(record, ReportSettings()), tmp_path)
    assert seen["errors"] == []
    assert seen["loaded"] == []
    if seen["solid"].startswith("This browser cannot draw in 3-D (it has no WebGL)"):
        pytest.skip("this Chromium has no WebGL; the page says so, as it should")
    assert seen["solid"].startswith("Drag to turn")
    assert seen["turned"]

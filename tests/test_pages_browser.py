"""The report and a cohort's page in a real browser: on a desk, a phone, and paper."""

from __future__ import annotations

import base64
import io
from itertools import product

import numpy as np
import pytest
from browser import (
    NEEDS_BROWSER,
    SIZES,
    appear,
    asked_for,
    axe_findings,
    complaints,
    start_browser,
    too_wide,
)
from make_run import invoke, save_breast, write
from PIL import Image

from mammosim.report import contact_sheet, render_cohort
from mammosim.report.cohort_page import A_LESION, A_VIEW

pytestmark = NEEDS_BROWSER

LOOKS = list(product(SIZES, ("light", "dark")))


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A report of two views with a biopsy and the 3-D view."""
    folder = save_breast(tmp_path_factory.mktemp("report"))
    path = write(folder, views=["CC", "MLO"],
                 targets={"biopsy": {"view": "ML", "thickness_mm": 34}})  # fmt: skip
    result = invoke("run", path, "--output", folder / "run")
    assert result.exit_code == 0, result.output
    return folder / "run" / "report.html"


@pytest.fixture(scope="module")
def cohort(tmp_path_factory):
    """A cohort's page with pictures, plots, links, warnings and failures."""
    folder = tmp_path_factory.mktemp("cohort")
    rng = np.random.default_rng(4)
    patients = list(range(12))
    folders = [(number, folder / "patients" / f"{number:06d}") for number in patients]
    for _, place in folders:
        (place / "LCC").mkdir(parents=True)
        Image.fromarray(rng.integers(0, 255, (300, 150), dtype=np.uint8)).save(
            place / "LCC" / "preview.png"
        )
        (place / "report.html").write_text("a report")
    numbers = {name: list(rng.uniform(1.0, 60.0, 12)) for name, *_ in (*A_VIEW, *A_LESION)}
    table = {"patient": patients, "laterality": ["L"] * 12, "view": ["CC"] * 12,
             "kind": ["mass"] * 12, "density": ["fatty", "dense"] * 6,
             "phantom.generate.volume_ml": list(rng.uniform(200.0, 900.0, 12)),
             **numbers}  # fmt: skip
    drawn = {"density": ["fatty", "dense"], "phantom.generate.volume_ml": []}
    links = {number: f"patients/{number:06d}/report.html" for number in patients}
    page = render_cohort(
        "women", table, drawn, [(13, "no convergence")], contact_sheet(folder, folders),
        {3: ["LCC: force on the paddle: found 300 N, plausible up to 200 N"]}, links,
    )  # fmt: skip
    path = folder / "summary.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def shared_browser():
    driver = start_browser()
    yield driver
    driver.quit()


@pytest.fixture
def browser(shared_browser):
    asked_for(shared_browser), complaints(shared_browser)
    yield shared_browser
    elsewhere = ("http:", "https:", "ws:", "wss:")
    assert [url for url in asked_for(shared_browser) if url.startswith(elsewhere)] == []
    assert complaints(shared_browser) == []


@pytest.mark.parametrize(("size", "scheme"), LOOKS)
@pytest.mark.parametrize("name", ["report", "cohort"])
def test_a_page_is_accessible_and_fits(browser, request, name, size, scheme):
    appear(browser, size, scheme)
    browser.get(request.getfixturevalue(name).as_uri())
    assert axe_findings(browser) == []
    assert too_wide(browser) <= 0


def test_the_first_screen_of_a_report_has_its_four_things(browser, report):
    appear(browser)
    browser.get(report.as_uri())
    height = SIZES["desktop"][1]
    for heading in ("images", "moved", "dose", "uncertainty"):
        where = browser.execute_script(
            "return document.getElementById(arguments[0]).getBoundingClientRect().top", heading
        )
        assert 0 <= where < height, heading
    circles = browser.find_elements("css selector", ".first .mark.mass circle")
    assert circles
    assert all(circle.location["y"] < height for circle in circles)


def test_printed_pages_are_filled(browser, report):
    """Each page but the last is printed on to three quarters of its height at least."""
    pdfium = pytest.importorskip("pypdfium2", reason="pip install mammosim[browser]")
    browser.get(report.as_uri())
    printed = browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": False})
    document = pdfium.PdfDocument(io.BytesIO(base64.b64decode(printed["data"])))
    pages = [page.render(scale=0.5, grayscale=True).to_numpy() for page in document]
    document.close()
    assert len(pages) > 1
    filled = []
    for page in pages:
        grey = page.reshape(page.shape[:2])
        filled.append(np.flatnonzero((grey < 240).any(axis=1))[-1] / grey.shape[0])
    assert min(filled[:-1]) > 0.75, [round(part, 2) for part in filled]

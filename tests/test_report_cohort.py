"""The summary page of a cohort: its pictures, their links, and the order of what was chosen."""

from __future__ import annotations

import base64
import io
import re

import matplotlib.axes
import numpy as np
import pytest
from PIL import Image

from mammosim.plausibility import plausibility_warnings
from mammosim.report import contact_sheet, render_cohort
from mammosim.report.cohort_page import A_LESION, A_VIEW
from mammosim.report.contact_sheet import MAX_PATIENTS, ROWS


@pytest.fixture
def cohort(tmp_path):
    """Folders of patients: one with two pictures and a report, one with a picture, one without."""
    ramp = np.tile(np.arange(100, dtype=np.uint8), (400, 1))
    folders = [(number, tmp_path / "patients" / f"{number:06d}") for number in (0, 4, 7)]
    for (_, folder), views in zip(folders, (("RCC", "RMLO"), ("LCC",), ()), strict=True):
        folder.mkdir(parents=True)
        for view in views:
            (folder / view).mkdir()
            Image.fromarray(ramp).save(folder / view / "preview.png")
    (folders[0][1] / "report.html").write_text("a report")
    return tmp_path, folders


def picture(uri: str) -> np.ndarray:
    """What a data URI shows."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))))


def test_a_contact_sheet_shows_what_is_there_and_leads_to_reports(cohort):
    folder, patients = cohort
    first, second = contact_sheet(folder, patients)
    assert (first.patient, first.link) == (0, "patients/000000/report.html")
    assert [name for name, _ in first.pictures] == ["RCC", "RMLO"]
    assert (second.patient, second.link) == (4, "")
    small = picture(first.pictures[0][1])
    assert small.shape == (ROWS, 50)
    # Every second column of the ramp, as JPEG of quality 88 keeps it.
    np.testing.assert_allclose(small[ROWS // 2], np.arange(50) * 2.0 + 0.5, atol=3)


def test_a_large_cohort_shows_its_first_patients(cohort):
    folder, patients = cohort
    assert len(contact_sheet(folder, patients[:1] * (MAX_PATIENTS + 5))) == MAX_PATIENTS


def test_the_page_links_the_pictures_and_keeps_the_order_of_a_choice(cohort, monkeypatch):
    folder, patients = cohort
    drawn_bars = []
    monkeypatch.setattr(
        "matplotlib.axes.Axes.bar", lambda self, names, counts, **_: drawn_bars.append(names)
    )
    table = {
        "patient": [0, 4], "laterality": ["R", "L"], "view": ["CC", "CC"],
        "kind": ["nipple", "nipple"],
        "density": ["dense", "fatty"],
        **{column: [None, None] for column, _, _ in (*A_VIEW, *A_LESION)},
    }  # fmt: skip
    drawn = {"density": ["fatty", "scattered", "dense"]}
    page = render_cohort("mine", table, drawn, [], contact_sheet(folder, patients))
    assert re.findall(r'<a href="([^"]+)"', page) == ["patients/000000/report.html"]
    assert page.count("data:image/jpeg") == 3
    assert "<figcaption>patient 4</figcaption>" in page
    assert drawn_bars == [["fatty", "scattered", "dense"]]


def test_the_page_counts_the_same_view_of_both_breasts_as_two_pictures():
    table = {
        "patient": [0, 0, 0], "laterality": ["R", "R", "L"], "view": ["CC", "CC", "CC"],
        "kind": ["mass", "nipple", "nipple"],
        **{column: [None] * 3 for column, _, _ in (*A_VIEW, *A_LESION)},
    }  # fmt: skip
    assert (
        "1 patient, 2 pictures, 1 lesion seen in a view each, 0 patients failed"
        in render_cohort("mine", table, {}, [])
    )


def test_the_page_counts_patients_by_limit_and_lists_their_warnings():
    table = {
        "patient": [0, 4], "laterality": ["R", "L"], "view": ["CC", "CC"],
        "kind": ["nipple", "nipple"],
        **{column: [None, None] for column, _, _ in (*A_VIEW, *A_LESION)},
    }  # fmt: skip
    loads = [f"LCC: {warning}" for warning in plausibility_warnings({"tube_load_mas": 900.0})]
    warnings = {0: [*loads, "laterality: a <guess>"], 4: [*loads, *loads]}
    page = render_cohort("mine", table, {}, [], warnings=warnings)
    assert '<tr><td>tube load</td><td class="n">2</td></tr>' in page
    assert '<tr><td>other</td><td class="n">1</td></tr>' in page
    assert 'class="text">laterality: a &lt;guess&gt;' in page
    assert page.count("LCC: tube load: found 900 mAs") == 3
    assert "Warnings" not in render_cohort("mine", table, {}, [])


def test_the_page_speaks_in_words_shows_ranges_and_leads_to_every_patient(monkeypatch):
    shaded, limits = [], []
    monkeypatch.setattr(
        "matplotlib.axes.Axes.axvspan", lambda self, *range, **_: shaded.append(range)
    )
    plot = matplotlib.axes.Axes.plot
    monkeypatch.setattr(
        "matplotlib.axes.Axes.plot",
        lambda self, *points, **keys: limits.append(points) or plot(self, *points, **keys),
    )
    table = {
        "patient": [0, 4], "laterality": ["R", "L"], "view": ["CC", "CC"],
        "kind": ["mass", "mass"], "phantom.lesions.0.diameter_mm": [8.0, 9.0],
        **{column: [None, None] for column, _, _ in A_LESION},
        **{column: [30.0, 60.0] for column, _, _ in A_VIEW},
    }  # fmt: skip
    links = {index: f"patients/{index:06d}/report.html" for index in (0, 4)}
    drawn = {"phantom.lesions.0.diameter_mm": []}
    page = render_cohort("mine", table, drawn, [(4, "a <reason>")], links=links)
    assert "Lesion 1: diameter, mm" in page
    assert "phantom.lesions" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    assert shaded == [(49.0, 186.0), (0.0, 45.0)]
    across, accepted = limits[0]
    assert np.interp(53.0, across, accepted) == pytest.approx(2.5, abs=0.02)
    assert page.count('<a href="patients/000004/report.html">4</a>') == 2  # among all, and failed
    assert "a &lt;reason&gt;" in page
    assert "1 patient failed" in page
    assert 'name="color-scheme" content="light dark"' in page

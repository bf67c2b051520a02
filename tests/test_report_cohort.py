"""The summary page of a cohort: its pictures, their links, and the order of what was chosen."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from mammosim.plausibility import doubts
from mammosim.report import contact_sheet, render_cohort
from mammosim.report.cohort_page import A_LESION, A_VIEW
from mammosim.report.contact_sheet import MOST_PATIENTS, ROWS


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
    assert len(contact_sheet(folder, patients[:1] * (MOST_PATIENTS + 5))) == MOST_PATIENTS


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
    assert re.findall(r'href="([^"]+)"', page) == ["patients/000000/report.html"]
    assert page.count("data:image/jpeg") == 3
    assert "<figcaption>patient 4</figcaption>" in page
    assert drawn_bars == [["fatty", "scattered", "dense"]]


def test_the_page_counts_the_same_view_of_both_breasts_as_two_pictures():
    table = {
        "patient": [0, 0, 0], "laterality": ["R", "R", "L"], "view": ["CC", "CC", "CC"],
        "kind": ["mass", "nipple", "nipple"],
        **{column: [None] * 3 for column, _, _ in (*A_VIEW, *A_LESION)},
    }  # fmt: skip
    assert "1 patients, 2 pictures, 1 lesions" in render_cohort("mine", table, {}, [])


def test_the_page_counts_patients_by_limit_and_lists_their_warnings():
    table = {
        "patient": [0, 4], "laterality": ["R", "L"], "view": ["CC", "CC"],
        "kind": ["nipple", "nipple"],
        **{column: [None, None] for column, _, _ in (*A_VIEW, *A_LESION)},
    }  # fmt: skip
    loads = [f"LCC: {doubt}" for doubt in doubts({"tube_load_mas": 900.0})]
    warnings = {0: [*loads, "laterality: a <guess>"], 4: [*loads, *loads]}
    page = render_cohort("mine", table, {}, [], warnings=warnings)
    assert "<tr><td>tube load<td>2</tr>" in page
    assert "<tr><td>other<td>1</tr>" in page
    assert 'class="text">laterality: a &lt;guess&gt;' in page
    assert page.count("LCC: tube load: found 900 mAs") == 3
    assert "Warnings" not in render_cohort("mine", table, {}, [])

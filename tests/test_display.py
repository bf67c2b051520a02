"""How results show, draw and save themselves, and what `import mammosim` costs."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from make_records import (
    make_compressed,
    make_mammogram,
    make_paths,
    make_phantom,
    make_targets,
)
from pydicom import dcmread

from mammosim import InputError, Study
from mammosim.geometry import View
from mammosim.pipeline import ViewResult, config_of
from mammosim.pipeline.run.notebook_bar import notebook_bar

CC, MLO = View("CC", "L"), View("MLO", "L")


@pytest.fixture(autouse=True)
def _without_a_screen():
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")


def study(*views: View) -> Study:
    results = {
        view.folder: ViewResult(
            make_compressed(view), make_paths(view), make_mammogram(view), tuple(make_targets(view))
        )
        for view in views
    }
    return Study((make_phantom(),), results)


RECORDS = {
    "breast": make_phantom,
    "compressed": lambda: make_compressed(CC),
    "mammogram": lambda: make_mammogram(CC),
    "study": lambda: study(CC, MLO),
}


@pytest.mark.parametrize("make", [*RECORDS.values(), lambda: make_paths(CC)])
def test_a_result_says_in_one_line_what_it_is(make):
    text = repr(make())
    assert len(text) < 200
    assert "array(" not in text
    assert "\n" not in text


def test_the_line_names_side_size_and_what_is_in_it():
    assert repr(make_phantom()) == (
        "<BreastPhantom L: 22 x 43 x 43 voxels of 2 x 2 x 2 mm, 3 lesions, from hemisphere.nii.gz>"
    )
    assert repr(make_compressed(CC)) == "<CompressedBreast LCC: springs, 52.0 mm, 91.3 N>"
    assert repr(make_compressed(CC, converged=False)).endswith("not converged>")
    assert repr(study(CC, MLO)) == "<Study of L: LCC, LMLO, 3 lesions>"


class Tags(HTMLParser):
    """Fails on tags that do not close in order; gathers text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in ("img", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words = " ".join(f"{self.words} {data}".split())


@pytest.mark.parametrize(
    ("name", "pictures", "words"),
    [
        ("breast", 3, ("Volume without muscle", "mass 1 (mass)", "hemisphere.nii.gz")),
        ("compressed", 6, ("Compressed thickness 52.0 mm", "Force on the paddle 91.3 N")),
        ("mammogram", 1, ("Tube voltage 28 kV", "Mean glandular dose 1.46 mGy")),
        ("study", 2, ("LCC LMLO", "mass 1", "Mean glandular dose 1.46 1.46 mGy")),
    ],
)
def test_a_notebook_shows_pictures_and_facts_and_loads_nothing(name, pictures, words):
    html = RECORDS[name]()._repr_html_()
    shown = Tags(html)
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert len(sources) == pictures
    assert all(source.startswith("data:image/jpeg;base64,") for source in sources)
    for word in words:
        assert word in shown.words
    assert len(html) < 200_000


def test_names_cannot_break_a_notebook():
    nasty = "<script>alert(1)</script>"
    html = dataclasses.replace(make_phantom(), source=nasty)._repr_html_()
    assert nasty not in html
    assert nasty in Tags(html).words


def test_a_compression_with_doubts_says_them():
    assert (
        "Three cells folded." in make_compressed(CC, notes=("Three cells folded.",))._repr_html_()
    )


def test_a_view_that_was_not_exposed_is_shown_as_far_as_it_came():
    unexposed = Study((make_phantom(),), {"LCC": ViewResult(make_compressed(CC))})
    assert "no image was made" in unexposed._repr_html_()
    with pytest.raises(InputError, match="no mammogram"):
        unexposed.plot()


def test_a_breast_is_drawn_in_three_planes():
    axes = make_phantom().plot()
    assert [one.get_title().split(",")[0] for one in axes] == ["frontal", "sagittal", "transverse"]
    places = np.array([lesion.position_mm for lesion in make_phantom().lesions])
    right, down = axes[0].lines[0].get_data()
    np.testing.assert_allclose(np.stack([right, -down], axis=1), places[:, 1:])


def test_arrows_lead_from_where_tissue_was_to_where_it_is():
    compressed = make_compressed(CC)
    frontal = compressed.plot("displacement")[0]
    (arrows,) = (one for one in frontal.collections if hasattr(one, "U"))
    assert arrows.N > 50
    points = np.stack([np.full(arrows.N, compressed.phantom.lesions[0].position_mm[0]),
                       arrows.XY[:, 0], -arrows.XY[:, 1]], axis=1)  # fmt: skip
    moved = compressed.displacement_at(points)
    np.testing.assert_allclose(arrows.U, moved[:, 1], atol=1e-6)
    np.testing.assert_allclose(-arrows.V, moved[:, 2], atol=1e-6)


def test_a_compression_is_drawn_before_and_after_and_its_convergence():
    compressed = make_compressed(CC)
    planes = compressed.plot()
    assert planes.shape == (2, 3)
    before, after = (np.asarray(one.images[0].get_array()) for one in planes[:, 0])
    assert np.ptp(np.flatnonzero(after.any(axis=1))) < np.ptp(np.flatnonzero(before.any(axis=1)))
    lines = compressed.plot("convergence").lines
    assert lines
    with pytest.raises(InputError, match="found 'plane', expected one of planes, displacement"):
        compressed.plot("plane")


def test_a_mammogram_is_drawn_through_its_window_with_its_lesions():
    mammogram = make_mammogram(CC)
    axes = mammogram.plot([*make_targets(CC), *make_targets(MLO)])
    assert axes.images[0].get_clim() == (1000.0, 3400.0)
    target = make_targets(CC)[0]
    centres = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines]
    assert len(centres) == 4  # three lesions and the nipple; the landmark is outside
    assert centres[0] == pytest.approx((target.image_col_px, target.image_row_px))
    assert mammogram.plot(window=(500.0, 200.0)).images[0].get_clim() == (400.0, 600.0)


def test_a_study_is_drawn_into_axes_of_ones_own():
    import matplotlib.pyplot as plt

    _, mine = plt.subplots(1, 2)
    drawn = study(CC, MLO).plot(axes=mine)
    assert [one.get_title() for one in drawn] == ["LCC", "LMLO"]
    assert drawn[0] is mine[0]
    with pytest.raises(InputError, match="axes: found 2, expected 3"):
        make_phantom().plot(axes=mine)


def test_importing_the_package_loads_no_library():
    """That, and no time, is tested: what takes long are NumPy, SciPy, Numba and matplotlib."""
    code = (
        "import sys, mammosim; assert 'simulate' in dir(mammosim);"
        "print(sorted({'numpy', 'scipy', 'numba', 'matplotlib', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_notebook_shows_a_bar_while_a_run_goes_on(monkeypatch):
    shown = []

    class Bar:
        def update(self, html):
            shown.append(html.data)

    class HTML:
        def __init__(self, data):
            self.data = data

    def display(html, display_id):
        shown.append(html.data)
        return Bar()

    ipython = SimpleNamespace(HTML=HTML, display=display)
    monkeypatch.setitem(sys.modules, "ipykernel", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(display=ipython))
    monkeypatch.setitem(sys.modules, "IPython.display", ipython)
    config = config_of({"phantom": {"generate": {}}}, Path(), "any.yaml")
    with notebook_bar(config, None) as on_progress:
        on_progress("LCC", "compression", None)
    assert "starting" in shown[0]
    assert "LCC: compressing (" in shown[1]
    assert shown[-1].startswith('<progress value="1.000"')
    assert "done" in shown[-1]
    with pytest.raises(InputError), notebook_bar(config, None):
        raise InputError("no")
    assert "stopped" in shown[-1]


def test_elsewhere_there_is_no_bar_and_ones_own_progress_is_kept(monkeypatch):
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    config = config_of({"phantom": {"generate": {}}}, Path(), "any.yaml")
    with notebook_bar(config, None) as on_progress:
        assert on_progress is None
    mine = lambda view, stage, row: None  # noqa: E731
    with notebook_bar(config, mine) as on_progress:
        assert on_progress is mine


def test_a_mammogram_is_saved_as_a_run_saves_it(tmp_path):
    mammogram = make_mammogram(CC)
    for name in ("a", "b"):
        mammogram.save(tmp_path / name)
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {
        "for_processing.dcm", "for_presentation.dcm", "mammogram.tif", "preview.png",
        "for_presentation.png", "geometry.json",
    }  # fmt: skip
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    other = make_mammogram(CC, seed=2)
    other.save(tmp_path / "c")
    uids = {dcmread(tmp_path / name / "for_processing.dcm").SOPInstanceUID for name in "ac"}
    assert len(uids) == 2


def test_a_study_is_saved_as_the_run_that_it_is(tmp_path):
    keys = {"phantom": {"generate": {}}, "export": {"viewers": True}, "report": {"three_d": False}}
    whole = dataclasses.replace(study(CC, MLO), config=config_of(keys, Path(), "any.yaml"))
    whole.save(tmp_path / "run")
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["status"] == "done"
    for name in ("report.html", "lesions.csv", "uncompressed.seg.nrrd", "lesions.mrk.json",
                 "LCC/for_presentation.dcm", "LCC/displacement.nii.gz", "LCC/lesions.mrk.json",
                 "LMLO/compressed.seg.nrrd", "LMLO/lesion_mask.dcm"):  # fmt: skip
        assert (tmp_path / "run" / name).stat().st_size > 0, name
    with pytest.raises(InputError, match="exists and is not empty; give overwrite=True"):
        whole.save(tmp_path / "run")
    whole.save(tmp_path / "run", overwrite=True)
    with pytest.raises(InputError, match="the study has no configuration"):
        study(CC).save(tmp_path / "other")

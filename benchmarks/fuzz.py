"""Bad input, systematically: configurations, cohorts, files, folders and commands with faults.

    python benchmarks/fuzz.py [--configurations 100000] [--files 10000] [--runs 300]
        [--seed 1]

Every input is a sound one with a few things changed. Each must be used, or refused with an
`InputError` whose lines say something. Counted as failures: any other exception, more than
20 seconds, more memory than the size of the input allows, a file written, renamed or removed
outside the sandbox, a process started, a connection made. Ends with status 1 if there are any.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import copy
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
import tracemalloc
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numba
import numpy as np
import trimesh
from make_run import invoke, save_breast, write
from make_volumes import FORMATS, save, small_breast

from mammosim.acquisition import AcquisitionSettings, check_acquisition, expose
from mammosim.acquisition.spectrum import make_beam
from mammosim.cohort import cohort_status, load_cohort, plan_cohort
from mammosim.compression import compress
from mammosim.config import read_yaml
from mammosim.errors import InputError, NotConverged
from mammosim.phantom import generate_phantom, make_phantom, read_phantom
from mammosim.phantom.lesion_shapes import read_shape
from mammosim.pipeline import (
    RunConfig,
    RunFolder,
    apply_change,
    check_before,
    check_settings,
    config_of,
    is_finished,
    load_config,
    locate_in_run,
    make_plan,
    simulate,
)
from mammosim.projection import project
from mammosim.tissues import load_label_map

CONFIGS = Path(__file__).parents[1] / "configs"
MAX_SECONDS = 20
"""Of the processor; ten times as long by the clock, for a machine that has others to serve."""

RUN_SECONDS = 200
"""The same of a whole run, which may compile kernels."""

BOMBS = 0.05
"""Part of the trials for them that are bombs: they take a hundred times as long as others."""

CHECKED = 0.01
"""Part of the sound configurations that are checked as `mammosim check` does: it takes seconds."""

SPARE_BYTES = 24 << 20
"""Buffers of readers and libraries, beside a quarter more than an input honestly needs."""

HOSTILE: list[Any] = [
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**400, -0.0, 1e-300, 1e308, float("nan"),
    float("inf"), "", " ", "nan", "1", "\0", "é½", "a" * 10_000, "../../../etc/passwd", "/dev/zero",
    "/dev/full", "/proc/self/mem", ".", "/", "~root/.ssh", "x.npy", "http://localhost/x.nrrd",
    "file:///etc/passwd", "{{ 7 * 7 }}", "%s%s%n", "$(touch pwned)", "`touch pwned`", "!!python/x",
    "__import__('os').system('touch pwned')", [], [[]], [None], {}, {"": {}}, {"__class__": "x"},
    {"choice": [1, "a"]}, {"uniform": [1, 2]}, {"normal": [1, 1e308]}, {"column": "x"},
    {"choice": [], "weights": [1e308, 1e308]}, [1, 2, 3], [1e308] * 3, "L", "CC", ["CC"], "dense",
    "~nosuchuser/x.yaml", "~", "fifo.yaml", "fifo.npz", "fifo", "folder.yaml", "device.yaml",
    "device.npz", "/dev/stdin", "/dev/tty", "=1+1", "+1", "-1", "@SUM(1)", "[/]", "[bold]x[/bold]",
    ":heart:", "\x1b[2J", "\u202e", "\u2028", "a\\b", 16**4000, -(2**127), 1e9, 1e-9, 101, 500,
    [{"name": "a", "kind": "clip"}] * 200, {"name": "[/]", "kind": "mass"}, "MLO", {"merge_mm": 0},
    {"view": "CC", "thickness_mm": 1e-3}, [[[[[]]]]], "0x" + "f" * 5000, "\ud800",
]  # fmt: skip

TEXTS = [
    "!!python/object/apply:os.system ['touch pwned']", "!!python/name:os.system", "&a [*a]", "*b",
    "<<: *b", "!!binary AAAA", "!!set {a}", "? [a]", "--- 1\n--- 2", "\t", "{", "}", "[", "'",
    '"', "|\n", ">\n", "&a {k: 1}", "<<: [*a, *a, *a]", "a: &a {<<: *a}", "0x" + "f" * 300,
    "1:1:1:1", "%YAML 1.1\n---\n", "[" * 60, "{a: " * 60, "- " * 60, "? " * 60, "9" * 5000,
    "!!int '0b1'", "%YAML 9.9", "\x00", "\ufeff", "\u2028", "0x", "1_000", "1e", ": :", "- -",
    "@",
]  # fmt: skip

EVERYTHING: list[dict[str, Any]] = [
    {
        "patient": {"id": "P-1", "name": "Doe^Jane", "birth_date": "19700102", "sex": "F",
                    "accession": "A1", "study_uid_from": "one study"},
        "phantom": {
            "generate": {"density": "b", "voxel_mm": 2.0, "volume_ml": 300},
            "lesions": [
                {"name": "m", "kind": "mass", "file": "mass.stl", "rotation_deg": [0, 30, 0],
                 "laterality": "R", "position_mm": [30, 0, 0]},
                {"name": "v", "kind": "mass", "file": "mass.npy", "voxel_mm": 1.0},
                {"name": "k", "kind": "calcification", "diameter_mm": 5},
            ],
            "landmarks": [{"name": "p", "position_mm": [20, 0, 0], "laterality": "L"}],
        },
        "laterality": ["R", "L"],
        "compression": {"model": "hyperelastic", "resolution_mm": 6, "gravity": True,
                        "skin": {"young_kpa": 60, "thickness_mm": 1.5}, "fibres": {"ratio": 2},
                        "chest_wall": "fascia", "tolerance_mm": 0.05},
        "acquisition": {"contrast": {"lesion_mg_ml": 1.0, "kvp": 49, "filter": "Cu"},
                        "scatter": {"model": "kernels"}, "look": "soft"},
        "views": [
            "MLO",
            {"view": "CC", "name": "CC_spot", "laterality": "R",
             "paddle": {"size_mm": [60, 80], "centre_mm": [40, 0], "tilt": {"angle_deg": 3}}},
            {"view": "ML", "paddle": {"tilt": {"spring_nm_per_deg": 0.2, "hinge_mm": 30}}},
        ],
        "targets": {"biopsy": {"view": "none", "posture": "prone", "needle": "lateral"}},
        "export": {"dose_map": True, "compressed_formats": ["nrrd", "victre"]},
    },
    {
        "phantom": {"file": {"L": "left.npz", "R": "right.npz"}, "compressed_for": "CC",
                    "lesions_from_labels": {"merge_mm": 2, "min_volume_mm3": 0.05}},
        "laterality": ["L", "R"],
        "compression": {"model": "none"},
        "acquisition": {"noise_seed": 4, "grid": False},
        "projection": {"support_to_detector_mm": 290, "pixel_mm": 1.0},
        "views": [
            {"view": "CC", "realisations": 2},
            {"dbt": {"view": "CC", "projections": 5, "angle_range_deg": 20,
                     "reconstruct": {"method": "sart", "slice_mm": 2}}},
        ],
    },
    {
        "phantom": {"file": "mtype.txt", "labels": "numbers.yaml", "reduce": 2},
        "compression": {"model": "hyperelastic", "thickness_mm": 40, "force_tolerance": 0.1,
                        "stiffness_kpa": {"gland": 20}},
        "targets": {"biopsy": {"view": "same", "force_n": 80}, "uncertainty": {"samples": 10}},
        "views": [{"view": "MLO", "acquisition": {"mas": 60}, "thickness_mm": 50}],
    },
]  # fmt: skip
"""Configurations with the keys of an exam, lesions from files, a contrast pair, paddles, a posture,
precompressed breasts, reconstruction, a text phantom and several draws."""

EXTREME_SECTIONS = ("compression", "projection", "acquisition", "targets")
"""Sections whose numbers are taken to their ends in whole runs."""

FOLLOWS = ("os.truncate", "os.chmod", "os.chown")
"""Events that act on what a link leads to; making, renaming and removing act on the link."""

SANDBOX = Path(tempfile.mkdtemp()).resolve()
strangers: list[str] = []
"""What was done that no input may do."""


class Hang(BaseException):
    """More than `MAX_SECONDS`."""


def main() -> None:
    """Try as many as asked for, and say what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--configurations", type=int, default=100_000)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    rng = random.Random(wanted.seed)
    try:
        os.chdir(SANDBOX)
        sound = Sound(SANDBOX / "sound")
        signal.signal(signal.SIGALRM, _hang)
        signal.signal(signal.SIGPROF, _hang)
        _odd_files(SANDBOX)
        sys.addaudithook(_watch)
        failures = 0
        values = (try_values, try_cohort, try_change, try_bomb, try_values)
        kinds = {
            "configurations": (*values, try_text),
            "runs": (try_extremes,),
            "files": (
                try_phantom,
                try_phantom,
                try_array,
                try_run_folder,
                try_cohort_folder,
                try_label_table,
                try_table_of_materials,
                try_no_file,
                try_shape,
                try_text_phantom,
                try_output,
                try_command,
                try_keywords,
            ),
        }
        for kind, count in (
            ("configurations", wanted.configurations),
            ("files", wanted.files),
            ("runs", wanted.runs),
        ):
            start, counts = time.monotonic(), collections.Counter[str]()
            for number in range(count):
                trial = kinds[kind][number % len(kinds[kind])]
                failures += attempt(trial, sound, rng, counts, f"{kind} {number}")
            print(f"{count} {kind} in {time.monotonic() - start:.0f} s: {dict(counts)}", flush=True)
    finally:
        shutil.rmtree(SANDBOX, ignore_errors=True)
    print(f"{failures} failures")
    sys.exit(1 if failures else 0)


class Sound:
    """Sound inputs, that faults are put into."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.run_values = [
            read_yaml(CONFIGS / f"{name}.yaml")
            for name in ("quickstart", "own_phantom", "victre", "exam", "tomosynthesis")
        ]
        self.run_values += EVERYTHING
        self.cohort_values = read_yaml(CONFIGS / "cohort.yaml")
        self.texts = [path.read_text() for path in sorted(CONFIGS.glob("*.yaml"))]
        self.schema = RunConfig.model_json_schema()
        self.phantoms: list[tuple[str, dict[str, bytes]]] = []
        for number, suffix in enumerate(FORMATS):
            place = folder / f"phantom{number}"
            place.mkdir()
            name = f"b.{suffix.lstrip('.')}"
            save(place / name, small_breast())
            self.phantoms.append((name, _contents(place)))
        self.config = write(save_breast(folder), views=["CC"])
        self.settings = load_config(self.config)
        result = invoke("run", self.config, "--output", folder / "run")
        self.own = folder / "run" / "LCC"
        if result.exit_code:
            raise RuntimeError(result.output)
        self.run = _contents(folder / "run")
        self.breast = make_phantom(self.settings.phantom, self.settings.laterality)
        self.compressed = compress(self.breast, "CC", model="none")
        make_plan(config_of(EVERYTHING[0], SANDBOX, "warm.yaml"))
        plan_cohort(load_cohort(CONFIGS / "cohort.yaml"))  # compiles what a check needs
        self.paths = project(self.compressed, pixel_mm=2.0)
        self.shapes = _shapes(folder)


def attempt(
    trial: Callable[[Sound, random.Random], int],
    sound: Sound,
    rng: random.Random,
    counts: collections.Counter[str],
    name: str,
) -> int:
    """One input; 1 if something happened that must not."""
    state = rng.getstate()
    seconds = RUN_SECONDS if trial is try_extremes else MAX_SECONDS
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, 10 * seconds)
    said = ""
    try:
        allowed = trial(sound, rng)
        counts["used" if allowed >= 0 else "refused"] += 1
    except InputError as error:
        counts["refused"] += 1
        if not error.problems or not all(line.strip() for line in error.problems):
            said = "an error that says nothing"
    except Hang:
        said = f"more than {seconds} s: {traceback.format_exc(limit=-4)}"
    except BaseException:
        said = traceback.format_exc(limit=-4)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    if strangers:
        said += f" {strangers}"
        strangers.clear()
    if said:
        digest = hash(state) & 0xFFFFFFFF
        print(f"FAILED {name} ({trial.__name__}, state {digest:08x}): {said}", flush=True)
    return 1 if said else 0


def try_values(sound: Sound, rng: random.Random) -> int:
    """A run's configuration with some values, keys or sections changed."""
    values = copy.deepcopy(rng.choice(sound.run_values))
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        _change(values, rng, sound)
    config = config_of(values, SANDBOX, "fuzz.yaml")
    make_plan(config)
    if rng.random() < 0.02:
        check_settings(config)
        RunFolder(SANDBOX / "out", config)
    if rng.random() < CHECKED:
        check_before(config)
    return 0


def try_text(sound: Sound, rng: random.Random) -> int:
    """A file whose text is changed."""
    path = SANDBOX / "text.yaml"
    path.write_bytes(_changed_text(rng.choice(sound.texts), rng))
    load_config(path)
    return 0


def try_cohort(sound: Sound, rng: random.Random) -> int:
    """A cohort's values, drawn for one patient."""
    values = copy.deepcopy(sound.cohort_values)
    for _ in range(rng.choice((1, 1, 2))):
        _change(values, rng, sound)
    path = SANDBOX / "cohort.json"
    try:
        path.write_text(json.dumps(values))
    except (ValueError, TypeError):
        return 0
    cohort = load_cohort(path)
    cohort.config_of(rng.randrange(cohort.patients))
    if rng.random() < 0.01:
        plan_cohort(cohort)
    return 0


def try_extremes(sound: Sound, rng: random.Random) -> int:
    """A whole run with numbers from the ends of what the schema allows.

    It may be refused, or end unconverged; what it returns as done must be numbers.
    """
    values = read_yaml(sound.config)
    values["acquisition"] = {"scatter": {"model": rng.choice(("kernels", "none"))}}
    if rng.random() < 0.3:
        values["compression"].update(model="hyperelastic", resolution_mm=6)
    places = [place for place in _numbers(sound.schema) if place[0][0] in EXTREME_SECTIONS]
    for path, low, high in rng.sample(places, rng.choice((1, 1, 2, 4))):
        block = values
        for key in path[:-1]:
            block = block.setdefault(key, {})
            if not isinstance(block, dict):
                break
        else:
            near = rng.random() ** 3
            value = rng.choice((low, high, low + near * (high - low), high - near * (high - low)))
            block[path[-1]] = round(value) if isinstance(low, int) else value
    compression = values["compression"]
    if {"force_n", "support_z_mm", "paddle_z_mm", "plates_voxel"} & set(compression):
        compression.pop("thickness_mm", None)
    config = config_of(values, sound.config.parent, "fuzz.yaml")
    check_settings(config)
    plan = make_plan(config)
    if plan.memory_gb > 3.0 or plan.minutes > 3.0:
        return 0
    try:
        study = simulate(config)
    except NotConverged:
        return 0
    for row in study.targets:
        found = (row.shift_mm, row.x_mm, row.compressed_x_mm)
        if not np.isfinite(found).all():
            raise ValueError(f"target {row.name}: {found} for {values}")
    for view in study.views.values():
        image = view.mammogram
        if not np.isfinite((image.mas, image.dose_mgy, image.kvp)).all():
            raise ValueError(f"technique is no number for {values}")
    return 0


def _numbers(schema: dict[str, Any]) -> list[tuple[tuple[str, ...], float, float]]:
    """Path, smallest and largest value of every number of a run's sections."""
    found = []

    def walk(block: dict[str, Any], path: tuple[str, ...]) -> None:
        for one in (block, *block.get("anyOf", ())):
            if "$ref" in one and len(path) < 4:
                walk(schema["$defs"][one["$ref"].rpartition("/")[2]], path)
            low = one.get("minimum", one.get("exclusiveMinimum"))
            if low is not None and "maximum" in one:
                low = low if "minimum" in one else type(low)(low + 1e-6)
                found.append((path, low, one["maximum"]))
            for key, value in one.get("properties", {}).items():
                walk(value, (*path, key))

    walk(schema, ())
    return found


def try_change(sound: Sound, rng: random.Random) -> int:
    """`--set` with keys and values of any kind."""
    values = copy.deepcopy(rng.choice(sound.run_values))
    keys = [
        "phantom",
        "lesions",
        "0",
        "views",
        "compression",
        "generate",
        "-1",
        "9" * 30,
        "",
        "x.y",
    ]
    name = ".".join(rng.choice(keys) for _ in range(rng.randint(1, 4)))
    text = rng.choice([*TEXTS, "[CC]", "CC", "12", "{}", "[{name: a, kind: clip}]", "[1, [2]]"])
    apply_change(values, name + rng.choice(("=", "=", "=", "", "==")) + text)
    make_plan(config_of(values, SANDBOX, "fuzz.yaml"))
    return 0


def try_bomb(sound: Sound, rng: random.Random) -> int:
    """A short file that stands for a long one, or a file as long as allowed."""
    if rng.random() > BOMBS:
        return try_text(sound, rng)
    path = SANDBOX / "bomb.yaml"
    kind = rng.randrange(7)
    if rng.random() < 0.9 and kind > 1:
        kind = rng.randrange(2)
    width, depth = rng.randint(2, 12), rng.randint(2, 12)
    item = "<<: [{}]" if kind == 0 else "v: [{}]"
    lines = ["a0: &a0 {" + ", ".join(f"k{n}: {n}" for n in range(width)) + "}"]
    for level in range(1, depth):
        aliases = ", ".join([f"*a{level - 1}"] * rng.randint(1, width))
        lines.append(f"a{level}: &a{level} {{{item.format(aliases)}}}")
    size = rng.choice((1_000, 100_000, 400_000))
    text = {
        0: "\n".join(lines), 1: "\n".join(lines), 2: "seed: [" + "1," * size + "1]",
        3: "".join(f"k{n}: 1\n" for n in range(size // 10)), 4: "[" * size, 5: "a: " + "x" * size,
        6: "# c\n" * (size // 4),
    }[kind]  # fmt: skip
    path.write_text(text)
    load_config(path)
    return 0


def try_array(sound: Sound, rng: random.Random) -> int:
    """An NPY file, alone or in an archive, whose header is any literal."""
    kinds = ["'|u1'", "'<f2'", "'<c8'", "'|O'", "'<M8[ns]'", "()", "('|u1',)", "[('a', '|O')]",
             "('<i4', (0,))", "None", "True", "{}", "b'u1'", "'u1,u1'"]  # fmt: skip
    shapes = ["(5, 5, 5)", "(True, 5, 5)", "(5.0, 5, 5)", "(-5, 5, -5)", "()", "5", "[5, 5, 5]",
              "(2**70, 1, 1)", "(9223372036854775808, 1, 1)", "(0, 5, 5)", "('5', 5, 5)",
              "(1,) * 99"]  # fmt: skip
    kind = rng.choice(kinds) if rng.random() < 0.5 else kinds[0]
    shape = rng.choice(shapes) if rng.random() < 0.5 else shapes[0]
    order = rng.choice(("False", "True", "1", "'F'"))
    text = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}}}"
    if rng.random() < 0.3:
        at = rng.randrange(len(text))
        piece = rng.choice(["(", "-" * 500, "[", "'", "0", "\t", "#", "*", "1e999", "lambda:0"])
        text = text[:at] + piece + text[at + rng.choice((0, 1, 3)) :]
    header = text.encode("latin-1", "replace") + b" " * 64 + b"\n"
    content = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header + bytes(125)
    folder = _fresh("array")
    if rng.random() < 0.5:
        (folder / "a.npy").write_bytes(content)
        read_phantom(folder / "a.npy")
        return 0
    odd = rng.choice(("labels", "voxel_mm", "origin_mm"))
    with zipfile.ZipFile(folder / "a.npz", "w", rng.choice((0, 8, 12, 14))) as archive:
        for name, array in (("labels", np.ones((5, 5, 5), np.uint8)), ("voxel_mm", np.ones(3)),
                            ("origin_mm", np.zeros(3))):  # fmt: skip
            stream = io.BytesIO()
            np.save(stream, array)
            archive.writestr(f"{name}.npy", content if name == odd else stream.getvalue())
    read_phantom(folder / "a.npz")
    return 0


def try_label_table(sound: Sound, rng: random.Random) -> int:
    """A compressed breast of our own whose `labels.json` is faulty."""
    folder = _fresh("own")
    shutil.copy(sound.own / "compressed.nii.gz", folder)
    values = json.loads((sound.own / "labels.json").read_text())
    if rng.random() < 0.7:
        for _ in range(rng.choice((1, 1, 2))):
            _change(values, rng, sound)
        with contextlib.suppress(ValueError):  # a whole number too long for JSON
            (folder / "labels.json").write_text(json.dumps(values), "utf-8", "backslashreplace")
    else:
        (folder / "labels.json").write_bytes(_damaged(json.dumps(values).encode(), rng))
    breast = read_phantom(folder / "compressed.nii.gz")
    if breast.compressed is not None and breast.compressed.view is not None:
        compress(breast, breast.compressed.view, model="none")
    return 0


def try_table_of_materials(sound: Sound, rng: random.Random) -> int:
    """A file of materials, a spectrum or a label map with faults, as the acquisition uses it."""
    path = SANDBOX / rng.choice(("table.yaml", "table.txt"))
    number = rng.choice(
        ["0", "1", "100", "1e308", "1e-308", "-1", "nan", ".inf", "0x10", "a", "[]"]
    )
    other = rng.choice(["100", "50", "1e308", "0", "-0.0", "{}", number])
    if path.suffix == ".txt":
        path.write_text(f"{number} {other}\n20 1e5\n{rng.choice(('30', '150', '1e9'))} {number}\n")
        make_beam("W", "Rh", spectrum_file=str(path), kvp=rng.choice((None, 28.0)))
        return 0
    if rng.random() < 0.5:
        path.write_text(f"0: air\n{number}: {rng.choice(('adipose', 'fat', other, number))}\n")
        load_label_map(str(path))
        return 0
    element = rng.choice(("H", "Pb", "Xx", "1", "''", number))
    path.write_text(
        f"adipose: {{density_g_cm3: {number}, mass_percent: {{{element}: {other}, C: {number}}}}}\n"
    )
    settings = AcquisitionSettings(composition=str(path))
    check_acquisition(settings)
    return 0


def try_no_file(sound: Sound, rng: random.Random) -> int:
    """A pipe, device or folder in a place where a file is read."""
    name = rng.choice(("fifo", "device", "folder")) + rng.choice(
        (".yaml", ".json", ".npz", ".npy", ".mhd", ".nii.gz", ".csv", ".txt", ".nrrd", ".tif", "")
    )
    path = SANDBOX / name
    rng.choice((
        read_yaml, load_config, load_cohort, read_phantom, lambda at: load_label_map(str(at)),
        lambda at: make_beam("W", "Rh", spectrum_file=str(at)),
        lambda at: check_acquisition(AcquisitionSettings(composition=f"{at}.yaml")),
        lambda at: locate_in_run(at, ["CC"], [(1.0, 1.0)]),
        lambda at: is_finished(at, sound.settings),
    ))(path)  # fmt: skip
    return 0


def try_shape(sound: Sound, rng: random.Random) -> int:
    """A lesion's file with some bytes changed, cut off or added: surfaces, masks and HDF5."""
    name, content = rng.choice(sound.shapes)
    path = _fresh("shape") / rng.choice((name, name, rng.choice(sound.shapes)[0]))
    path.write_bytes(_damaged(content, rng))
    shape = read_shape(path, rng.choice((None, None, 1.0)))
    if not np.isfinite((shape.radius_mm, shape.volume_mm3)).all():
        raise ValueError(f"a shape without a size: {shape}")
    return 0


def try_text_phantom(sound: Sound, rng: random.Random) -> int:
    """A text phantom with odd numbers, under a label map that may not know them."""
    folder = _fresh("uwcem")
    path = save(folder / "mtype.txt", small_breast())
    lines = path.read_text().splitlines()
    for _ in range(rng.choice((0, 1, 3))):
        odd = ("nan", "1e999", "-1.0000001", "0x10", "1 2", "", "3,1", "-", "1e-320", "9" * 400)
        lines[rng.randrange(len(lines))] = rng.choice(odd)
    path.write_text("\n".join(lines))
    info = folder / "breastInfo.txt"
    if rng.random() < 0.3:
        info.write_bytes(_spliced(info.read_bytes(), rng))
    keys = ("-1", "-2", "-4", "1.1", "1.2", "2", "3.1", "nan", ".inf", "1e400", "-0.0", "1.10", "x")
    labels: str | None = None
    if rng.random() < 0.7:
        some = rng.sample(keys, rng.randint(1, len(keys)))
        tissues = ("adipose", "gland", "skin", "air", "fat", "muscle")
        text = "".join(f"{key}: {rng.choice(tissues)}\n" for key in some)
        (folder / "map.yaml").write_text(text)
        labels = str(folder / "map.yaml")
    read_phantom(path, labels)
    return 0


def try_output(sound: Sound, rng: random.Random) -> int:
    """A folder to write to that is a link, a file, a pipe, too long, or holds what is no run's."""
    folder = _fresh("output")
    place = folder / rng.choice(("o", "o/a/b", "x" * 300, "é½", "-", "a\nb", ".", "o\udcff"))
    inside = rng.choice(
        ("run.json", "LCC", "LCC/preview.png", "notes.txt", ".stages", "config.yaml")
    )
    what = rng.randrange(6)
    with contextlib.suppress(OSError):
        if what == 0:
            place.symlink_to(rng.choice(("/etc", "..", "nowhere", place)))
        elif what == 1:
            os.mkfifo(place)
        elif what == 2:
            place.write_text("mine")
        else:
            at = place / inside
            at.parent.mkdir(parents=True, exist_ok=True)
            if what == 3:
                at.symlink_to(rng.choice(("/etc/passwd", "/", "..", "gone")))
            elif what == 4:
                os.mkfifo(at)
            else:
                at.write_text(rng.choice(("", "{}", "[" * 5000, '{"status": "done"}')))
    run = RunFolder(place, sound.settings)
    is_finished(place, sound.settings)
    run.stages.make_folder()
    return 0


def try_command(sound: Sound, rng: random.Random) -> int:
    """A command line of odd words."""
    words = ["x.npz", "fifo.npz", "device.npz", "folder", "", " ", "-", "--", "--help", "a" * 5000,
             "~nosuchuser/x", "..", "\udcff", "[/]", "--labels", "--axes", "ALS", "AAA", "--reduce",
             "0", "-1", "9" * 30, "1e309", "nan", "--voxel-mm", "0.5,0.5", "1,2,3", "--set", "=",
             "views=[CC]", "seed=0x10", "--output", "--view", "CC", "LCC", "--pixel", "--height-mm",
             "--resume", str(sound.config), str(sound.own.parent), str(sound.own)]  # fmt: skip
    command = rng.choice(("info", "check", "locate", "convert", "schema", "new", "cohort status"))
    drawn = [rng.choice(words) for _ in range(rng.randint(0, 6))]
    if command == "convert":  # writes where it is told to
        target = _fresh("convert") / rng.choice(("a.npz", "a.mhd", "b", "c.x"))
        drawn = [*drawn[:1], str(target)]
    if command == "new":
        drawn = [word for word in drawn if word.startswith("-")]
    result = invoke(*command.split(), *drawn)
    if result.exit_code not in (0, 2) or "Traceback" in result.output:
        raise RuntimeError(f"{command} {drawn}: {result.exit_code} {result.exception!r}")
    return 0 if result.exit_code == 0 else -1


def try_keywords(sound: Sound, rng: random.Random) -> int:
    """Python's functions with values of any kind for their keywords."""
    function, kind, about = rng.choice((
        (partial(compress, sound.breast, "CC"), "CompressionSettings", {"model": "none"}),
        (partial(project, sound.compressed), "ProjectionSettings", {"pixel_mm": 2.0}),
        (partial(expose, sound.paths), "AcquisitionSettings", {"scatter": False}),
        (generate_phantom, "GenerateSettings", {}),
    ))  # fmt: skip
    names = sorted(sound.schema["$defs"][kind]["properties"])
    keys = {**about}
    for name in rng.sample(names, rng.choice((1, 1, 2))):
        keys[name] = copy.deepcopy(rng.choice(HOSTILE))
    if kind == "GenerateSettings":
        keys["voxel_mm"] = 4.0
    with contextlib.suppress(NotConverged):
        function(**keys)
    return 0


def _shapes(folder: Path) -> list[tuple[str, bytes]]:
    """Lesions' files: a ball as surfaces and as masks; also where configurations look for them."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=4.0)
    for ending in ("stl", "obj", "ply", "off"):
        ball.export(folder / f"mass.{ending}")
    mask = (np.indices((9, 9, 9)) - 4.0 < 3.5).all(axis=0).astype(np.uint8)
    np.save(folder / "mass.npy", mask)
    for ending in (".nii.gz", ".mhd", ".nrrd"):
        save(folder / f"mask{ending}", mask)
    shapes = [
        path for path in sorted(folder.iterdir()) if path.stem.split(".")[0] in ("mass", "mask")
    ]
    for name in ("mass.stl", "mass.npy"):
        shutil.copy(folder / name, SANDBOX)
    with contextlib.suppress(ImportError):
        import h5py

        with h5py.File(folder / "mass.h5", "w") as file:
            file["volume"] = mask
        shapes.append(folder / "mass.h5")
    return [(path.name, path.read_bytes()) for path in shapes]


def try_phantom(sound: Sound, rng: random.Random) -> int:
    """A phantom file with some bytes changed, cut off or added; its memory is watched."""
    name, contents = rng.choice(sound.phantoms)
    folder = _fresh("phantom")
    _write_faulty(folder, contents, rng)
    tracemalloc.start()
    try:
        breast = read_phantom(folder / name)
        honest = breast.labels.nbytes * 10
    except InputError:
        honest = 0
        raise
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        if peak > 1.25 * sum(map(len, contents.values())) * 20 + SPARE_BYTES:
            strangers.append(f"{peak / 1e6:.0f} MB of memory")
    return honest


def try_run_folder(sound: Sound, rng: random.Random) -> int:
    """A run's folder with a faulty file, given to `--resume` and to `locate`."""
    folder = _fresh("run")
    _write_faulty(folder, sound.run, rng)
    if rng.random() < 0.5:
        locate_in_run(folder, ["CC"], [(rng.uniform(0, 300), rng.uniform(0, 200))])
        return 0
    if not is_finished(folder, sound.settings):
        kept = RunFolder(folder, sound.settings).stages
        made = sound.compressed
        settings = sound.settings.compression
        kept.compression(sound.settings, settings, made.phantom, made.view, lambda: made)
    if (folder / "run.json").exists():
        load_config(folder / "run.json")
    return 0


def try_cohort_folder(sound: Sound, rng: random.Random) -> int:
    """A cohort's folder with a faulty record, given to `cohort status`."""
    folder = _fresh("cohort")
    values = {"cohort": {"patients": 3}, **copy.deepcopy(sound.run_values[0])}
    record = {"title": "fuzz", "folder": str(SANDBOX), "cohort_of": values}
    contents = {
        "cohort.json": json.dumps(record).encode(),
        "progress.json": b'{"patients": 3, "made": 1, "workers": 2, "seconds": 3.5}',
        "patients/000000/run.json": sound.run["run.json"],
        "patients/000001/failure.json": b'{"kind": "InputError", "reason": "too small"}',
    }
    _write_faulty(folder, contents, rng)
    cohort_status(folder)
    return 0


def _change(values: Any, rng: random.Random, sound: Sound) -> None:
    """One fault somewhere in plain values."""
    places = []

    def walk(block: Any) -> None:
        items = block.items() if isinstance(block, dict) else enumerate(block)
        for key, value in list(items):
            places.append((block, key))
            if isinstance(value, dict | list):
                walk(value)

    walk(values)
    block, key = rng.choice(places)
    what = rng.random()
    if what < 0.5:
        block[key] = copy.deepcopy(rng.choice(HOSTILE))
    elif what < 0.6:
        del block[key]
    elif what < 0.8:
        section = rng.choice(sorted(sound.schema["$defs"]))
        name = rng.choice(sorted(sound.schema["$defs"][section].get("properties", {"x": 0})))
        target = block if isinstance(block, dict) else values
        target[name] = copy.deepcopy(rng.choice(HOSTILE))
    elif what < 0.9 and isinstance(block, dict):
        block[_changed_text(str(key), rng).decode("utf-8", "replace")] = block.pop(key)
    else:
        block[key] = [copy.deepcopy(block[key])] * rng.randint(1, 3)


def _changed_text(text: str, rng: random.Random) -> bytes:
    return _spliced(text.encode("utf-8", "replace"), rng)


def _spliced(content: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(content) + 1)
        piece = rng.choice(TEXTS).encode() if rng.random() < 0.7 else rng.randbytes(2)
        content = content[:at] + piece + content[at + rng.choice((0, 0, 1, 5)) :]
    return content


def _write_faulty(folder: Path, contents: dict[str, bytes], rng: random.Random) -> None:
    """Write files, one of them with a fault."""
    faulty = rng.choice(sorted(contents))
    for name, content in contents.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_damaged(content, rng) if name == faulty else content)


def _damaged(content: bytes, rng: random.Random) -> bytes:
    what = rng.random()
    if what < 0.15:
        return content[: rng.randrange(len(content) + 1)]
    if what < 0.25:
        return content + rng.randbytes(rng.choice((1, 100, 10_000)))
    if what < 0.45:  # words put into a header, where there is text
        return _spliced(content, rng)
    damaged = bytearray(content)
    for _ in range(rng.randint(1, 6)):
        if damaged:
            end = rng.choice((min(400, len(damaged)), len(damaged)))
            damaged[rng.randrange(end)] = rng.randrange(256)
    return bytes(damaged)


def _odd_files(folder: Path) -> None:
    """What is no file, under every ending."""
    for ending in (
        ".yaml", ".json", ".npz", ".npy", ".mhd", ".nii.gz", ".csv", ".txt", ".nrrd", ".tif", ""
    ):  # fmt: skip
        os.mkfifo(folder / f"fifo{ending}")
        (folder / f"folder{ending}").mkdir()
        (folder / f"device{ending}").symlink_to("/dev/zero")


def _contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _fresh(name: str) -> Path:
    folder = SANDBOX / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def _hang(number: int, frame: Any) -> None:
    raise Hang


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    """Audit hook: notes what no input may cause."""
    if event in ("os.system", "os.exec", "os.fork", "os.posix_spawn", "subprocess.Popen",
                 "socket.connect", "ctypes.dlopen", "webbrowser.open"):  # fmt: skip
        strangers.append(f"{event} {arguments!r:.200}")
    elif event == "open" and isinstance(arguments[0], str | bytes):
        mode, flags = arguments[1] or "", arguments[2] or 0
        writes = any(letter in mode for letter in "wax+") or flags & (os.O_WRONLY | os.O_RDWR)
        if writes:
            _inside(event, arguments[0])
    elif event in ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.symlink", "os.link",
                   "os.truncate", "os.chmod", "os.chown", "shutil.rmtree"):  # fmt: skip
        for path in arguments[1:2] if event == "os.symlink" else arguments[:2]:
            if isinstance(path, str | bytes | os.PathLike):
                _inside(event, path, follows=event in FOLLOWS)


def _inside(event: str, path: Any, follows: bool = True) -> None:
    """Note what leads out of the sandbox: a link itself is in it, wherever it leads."""
    head, name = os.path.split(os.fsdecode(path).rstrip("/"))
    real = os.path.realpath(os.fsdecode(path)) if follows else f"{os.path.realpath(head)}/{name}"
    compiled = os.path.realpath(numba.config.CACHE_DIR or "__pycache__")
    if not real.startswith((str(SANDBOX), compiled)) and "__pycache__" not in real:
        strangers.append(f"{event} {real}")


if __name__ == "__main__":
    main()

"""What a cohort's file says, and what each patient draws from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from make_run import invoke
from PIL import Image
from scipy.stats import kstest, norm, truncnorm, uniform

from mammosim.cohort import load_cohort, plan_cohort
from mammosim.cohort.cluster import share_machine
from mammosim.cohort.cohort_progress import Progress
from mammosim.cohort.dataset import check_exports
from mammosim.cohort.description import part_of
from mammosim.cohort.distributions import KINDS, stream
from mammosim.cohort.patients_table import table_schema
from mammosim.cohort.status import cohort_status
from mammosim.config import write_yaml
from mammosim.errors import InputError
from mammosim.export import write_learning_pair
from mammosim.pipeline import RunConfig, make_plan

PHANTOM = {"generate": {"voxel_mm": 3.0, "volume_ml": {"uniform": [160, 260], "decimals": 0}}}


def cohort(folder, changes=(), **values):
    """A cohort of the given sections."""
    path = folder / "cohort.yaml"
    write_yaml({"cohort": {"patients": 8}, "phantom": PHANTOM, "seed": 3, **values}, path)
    return load_cohort(path, changes)


def draws(law: dict, count: int = 2000) -> np.ndarray:
    """Values that a distribution gives to as many patients."""
    kind = next(KINDS[key] for key in KINDS if key in law)
    checked = kind.model_validate(law)
    return np.array([checked.draw(stream(1, patient, "a.key"), {}) for patient in range(count)])


def test_draws_have_the_distribution_that_they_are_said_to_have():
    # Kolmogorov and Smirnov's test at a fixed seed: below 1e-3 one in a thousand laws would fall.
    assert kstest(draws({"uniform": [2, 5]}), uniform(2, 3).cdf).pvalue > 1e-3
    assert kstest(draws({"normal": [50, 8]}), norm(50, 8).cdf).pvalue > 1e-3
    cut = draws({"normal": [50, 8], "within": [48, 70]})
    assert kstest(cut, truncnorm(-0.25, 2.5, 50, 8).cdf).pvalue > 1e-3
    chosen = draws({"choice": ["a", "b", "c"], "weights": [1, 0, 3]})
    # Three standard deviations of a count of 2000 with p = 3/4 are 58.
    assert abs((chosen == "c").sum() - 1500) < 58
    assert not (chosen == "b").any()


def test_whole_numbers_and_decimals():
    assert {type(value) for value in draws({"uniform": [0, 9], "decimals": 0}).tolist()} == {int}
    assert all(round(v, 1) == v for v in draws({"normal": [0, 1], "decimals": 1}, 50))


def test_a_patient_depends_on_seed_number_and_key_alone(tmp_path):
    base = cohort(tmp_path)
    more = cohort(
        tmp_path,
        ["cohort.patients=5000"],
        compression={"model": "springs", "resolution_mm": {"uniform": [2, 4]}},
    )
    for patient in (5, 0, 7):
        drawn = more.drawn(patient)
        assert {key: drawn[key] for key in base.drawn(patient)} == base.drawn(patient)
    assert base.drawn(1) != base.drawn(2)
    assert cohort(tmp_path, ["seed=4"]).drawn(1) != base.drawn(1)
    # Taken once: what it is today it has to be tomorrow, on any machine.
    assert base.drawn(5) == {"phantom.generate.volume_ml": 238, "seed": 8748345030672684}


def test_seeds_of_many_patients_differ(tmp_path):
    base = cohort(tmp_path, ["cohort.patients=20000"])
    assert len({base.drawn(patient)["seed"] for patient in range(20000)}) == 20000


def test_a_configuration_without_distributions_in_it(tmp_path):
    config = cohort(tmp_path).config_of(2)
    assert isinstance(config, RunConfig)
    assert (
        config.phantom.generate.volume_ml == cohort(tmp_path).drawn(2)["phantom.generate.volume_ml"]
    )


def test_values_from_a_file_of_patients(tmp_path):
    (tmp_path / "people.csv").write_text(
        "mm,side,size,soft\n40,L,10,true\n41.5,R,,false\n", encoding="utf-8"
    )
    lesion = {"name": "m", "kind": "mass", "diameter_mm": {"column": "size"}}
    found = cohort(
        tmp_path,
        cohort={"patients_file": "people.csv"},
        compression={"thickness_mm": {"column": "mm"}},
        laterality={"column": "side"},
        phantom={**PHANTOM, "lesions": [lesion]},
    )
    assert found.patients == 2
    first, second = (found.config_of(patient) for patient in range(2))
    assert (first.compression.thickness_mm, second.compression.thickness_mm) == (40, 41.5)
    assert (first.laterality, second.laterality) == ("L", "R")
    assert (first.phantom.lesions[0].diameter_mm, second.phantom.lesions[0].diameter_mm) == (
        10, None,
    )  # fmt: skip
    kinds = {field.name: str(field.type) for field in table_schema(found)}
    assert kinds["compression.thickness_mm"] == "double"
    assert kinds["phantom.generate.volume_ml"] == "int64"
    assert kinds["laterality"] == "string"


def test_split_by_patient(tmp_path):
    found = cohort(tmp_path, cohort={"patients": 3000, "dataset": {}})
    parts = np.array([part_of(found, patient) for patient in range(3000)])
    # Three standard deviations: 75 of 2100 and 59 of 450.
    assert abs((parts == "train").sum() - 2100) < 75
    assert abs((parts == "test").sum() - 450) < 59
    assert part_of(cohort(tmp_path), 3) == ""


BAD = [
    ({"cohort": None}, r"cohort: found None, expected a section with 'patients'"),
    ({"cohort": {}}, r"patients or patients_file must be given"),
    ({"cohort": {"patients": 0}}, r"cohort.patients: found 0"),
    ({"cohort": {"patients": 2, "patient": 3}}, r"cohort.patient: unknown key; did you mean"),
    ({"cohort": {"patients": 2, "dataset": {"split": {"train": 1}}}}, r"add up to 1.3"),
    ({"seed": {"uniform": [1, 2]}}, r"seed: found .*, expected a whole number of 0 or more"),
    ({"laterality": {"choice": []}}, r"laterality.choice: found \[\]"),
    ({"laterality": {"choice": ["L"], "weights": [1, 2]}}, r"found 2 weights for 1 values"),
    ({"laterality": {"choice": ["L", "R"], "weights": [0, 0]}}, r"one of them above 0"),
    ({"laterality": {"choice": ["L"], "of": 1}}, r"laterality.of: unknown key"),
    ({"compression": {"thickness_mm": {"uniform": [5, 4]}}}, r"thickness_mm.*must not be above"),
    ({"compression": {"thickness_mm": {"normal": [5, 0]}}}, r"deviation must be above 0"),
    (
        {"compression": {"thickness_mm": {"normal": [5, 1], "within": [6, 6]}}},
        r"within: the first number must be below",
    ),
    ({"laterality": {"column": "side"}}, r"laterality: uses column 'side', but cohort.patients_"),
    ({"cohort": {"patients_file": "nowhere.csv"}}, r"nowhere.csv: no such file"),
    ({"cohort": {"patients_file": "."}}, r"cannot be read \(it is a folder, expected a file\)"),
    ({"cohort": {"patients_file": "/dev/zero"}}, r"cannot be read \(it is a device"),
    ({"cohort": {"patients_file": "twice.csv"}}, r"expected a header with unique column names"),
    ({"cohort": {"patients_file": "ragged.csv"}}, r"line 3: found 1 cells, expected 2"),
    ({"cohort": {"patients_file": "two.csv", "patients": 3}}, r"found 3, but .* has 2 lines"),
    ({"cohort": {"patients_file": "bytes.csv"}}, r"cannot be read as CSV in UTF-8"),
    (
        {"cohort": {"patients_file": "two.csv"}, "laterality": {"column": "sid"}},
        r"found no column 'sid' in .*; it has side, mm",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), BAD)
def test_bad_cohorts_are_refused_in_words(changes, message, tmp_path):
    (tmp_path / "two.csv").write_text("side,mm\nL,40\nR,41\n")
    (tmp_path / "twice.csv").write_text("a,a\n1,2\n")
    (tmp_path / "ragged.csv").write_text("a,b\n1,2\n3\n")
    (tmp_path / "bytes.csv").write_bytes(b"a\n\xff\n")
    with pytest.raises(InputError, match=message):
        cohort(tmp_path, **changes)


def test_a_file_that_is_no_cohort(tmp_path):
    (tmp_path / "list.yaml").write_text("[1, 2]")
    with pytest.raises(InputError, match="expected a mapping with the sections 'cohort'"):
        load_cohort(tmp_path / "list.yaml")
    with pytest.raises(InputError, match=r"cohort.json is missing"):
        cohort_status(tmp_path)


def test_memory_decides_how_many_workers_there_are(monkeypatch):
    monkeypatch.setattr("mammosim.cohort.cluster.CPU_COUNT", 8)
    monkeypatch.setattr("mammosim.cohort.cluster.available_bytes", lambda: 20e9)
    alone = share_machine(3.0, 100, None, None)
    assert (alone.count, alone.threads) == (6, 1)
    assert alone.memory_gb == pytest.approx(20 / 6)
    asked = share_machine(3.0, 100, 2, None)
    assert (asked.count, asked.threads, asked.memory_gb) == (2, 4, 10.0)
    assert share_machine(3.0, 100, None, 6.5).count == 2
    assert share_machine(3.0, 1, None, None).count == 1
    with pytest.raises(InputError, match=r"takes about 30 GB of memory, but 20 GB are available"):
        share_machine(30.0, 100, None, None)


@pytest.mark.parametrize(
    ("export", "message"),
    [
        ({"tiff": False}, r"export.tiff: found false, but cohort.dataset needs its masks"),
        ({"dicom": False}, r"export.dicom: found false, but cohort.dataset takes its images"),
    ],
)
def test_a_data_set_needs_the_files_that_it_is_made_of(export, message, tmp_path):
    found = cohort(tmp_path, export=export, cohort={"patients": 2, "dataset": {}})
    with pytest.raises(InputError, match=message):
        check_exports(found.config_of(0), found.settings.dataset, found.where)
    check_exports(found.config_of(0), None, found.where)


def test_a_pair_for_learning_is_made_of_a_runs_files(tmp_path):
    with pytest.raises(InputError, match=r"mammogram.tif: cannot be read \(No such file"):
        write_learning_pair(tmp_path, "processing", tmp_path / "i.png", tmp_path / "m.png")
    for name, value in (("mammogram.tif", 9000), ("lesion_mask.tif", 300)):
        tifffile.imwrite(tmp_path / name, np.full((4, 3), value, np.uint16))
    with pytest.raises(InputError, match=r"found a lesion numbered 300, expected at most 255"):
        write_learning_pair(tmp_path, "processing", tmp_path / "i.png", tmp_path / "m.png")
    tifffile.imwrite(tmp_path / "lesion_mask.tif", np.eye(4, 3, dtype=np.uint8) * 7)
    write_learning_pair(tmp_path, "processing", tmp_path / "i.png", tmp_path / "m.png")
    assert (np.array(Image.open(tmp_path / "i.png")) == 9000).all()
    assert np.array(Image.open(tmp_path / "m.png")).tolist() == (np.eye(4, 3) * 7).tolist()


def test_the_shipped_cohort_is_sound():
    found = load_cohort(Path(__file__).parents[1] / "configs" / "cohort.yaml")
    for patient in range(found.patients):
        assert make_plan(found.config_of(patient)).memory_gb < 4


def test_the_expected_end():
    progress = Progress(100, found=20, made=30, failed=10, running=4, workers=4, seconds=3600.0)
    assert progress.patients_per_hour == 40  # what was there before took no time
    assert progress.waiting == 36
    assert progress.seconds_left == 3600.0
    assert Progress(3).seconds_left is None


def test_check_tells_what_a_cohort_takes(tmp_path):
    cohort(tmp_path, seed=4)
    result = invoke("check", tmp_path / "cohort.yaml")
    assert result.exit_code == 0
    assert "cohort: 8 patients, seed 4\ndrawn: phantom.generate.volume_ml\n" in result.output
    assert "patient 0: phantom: generated" in result.output
    assert "GB of memory per worker" in result.output


def test_check_lists_what_is_wrong_with_the_first_patients(tmp_path):
    cohort(tmp_path, acquisition={"kvp": {"choice": [28, 60]}})
    result = invoke("check", tmp_path / "cohort.yaml")
    assert result.exit_code == 2
    faulty = [patient for patient in range(8) if f"patient {patient}: " in result.output]
    drawn = load_cohort(tmp_path / "cohort.yaml")
    assert faulty == [n for n in range(8) if drawn.drawn(n)["acquisition.kvp"] == 60]
    assert "acquisition.kvp: found 60, expected 20 to 49 kV" in result.output


def test_a_cohorts_file_is_not_a_runs(tmp_path):
    cohort(tmp_path)
    result = invoke("run", tmp_path / "cohort.yaml", "--output", tmp_path / "out")
    assert result.exit_code == 2
    assert "is a cohort's file; use mammosim cohort run" in result.output


def test_the_plan_of_a_cohort_shares_out_this_machine(tmp_path):
    found = plan_cohort(cohort(tmp_path, ["cohort.patients=200"]))
    assert "the first 50 patients were checked" in found.lines
    more = plan_cohort(cohort(tmp_path, ["cohort.patients=400"]))
    assert more.hours == pytest.approx(2 * found.hours)
    with pytest.raises(InputError, match=r"a patient takes about .* GB of memory, but 0.1 GB"):
        plan_cohort(cohort(tmp_path, ["cohort.memory_gb=0.1"]))

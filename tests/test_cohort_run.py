"""Nothing is lost: workers killed, the scheduler stopped, the disk full; the data are the same."""

from __future__ import annotations

import csv
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np
import psutil
import pyarrow.parquet
import pytest
from make_run import FEW_PHOTONS, invoke
from PIL import Image

from mammosim._wording import counted
from mammosim.cohort import cohort_status, load_cohort, run_cohort
from mammosim.cohort.cluster import Workers, local_client, wait_for_worker
from mammosim.cohort.patient import Patient, make_patient, worker_gb
from mammosim.cohort.settings import DatasetSettings
from mammosim.cohort.status import patient_folder
from mammosim.config import write_yaml
from mammosim.errors import InputError, Interrupted
from mammosim.export import text_of_csv
from mammosim.pipeline import make_plan, writing

PATIENTS = 5
FAULTY = 3
"""The patient whose lesion does not fit into its breast."""

TIMES = ("run.json", "report.html")
"""Files that hold times."""


def describe(folder: Path) -> Path:
    """A cohort of small patients, one of which fails."""
    sizes = [8, 9, 10, 95, 11]
    (folder / "people.csv").write_text("size\n" + "".join(f"{size}\n" for size in sizes))
    lesion = {"name": "mass", "kind": "mass", "diameter_mm": {"column": "size"}}
    values = {
        "cohort": {"patients_file": "people.csv", "dataset": {}},
        "phantom": {
            "generate": {
                "voxel_mm": 4.0, "volume_ml": {"uniform": [160, 200]},
                "density": {"choice": ["fatty", "scattered"]},
            },
            "lesions": [lesion],
        },
        "compression": {"model": "springs", "resolution_mm": 6},
        "projection": {"pixel_mm": 1.5},
        "acquisition": FEW_PHOTONS,
        "views": ["CC"],
        "laterality": {"choice": ["L", "R"]},
        "report": {"html": False},
        "seed": 11,
    }  # fmt: skip
    write_yaml(values, folder / "cohort.yaml")
    return folder / "cohort.yaml"


def data_of(folder: Path) -> dict[str, bytes]:
    """Every file of the patients and of the data set, but those that hold times."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for part in ("patients", "dataset")
        for path in sorted((folder / part).rglob("*"))
        if path.is_file() and path.name not in TIMES
    }


def task(description: Path, folder: Path, index: int, threads: int = 1, **changes) -> Patient:
    """What a worker is told of a patient."""
    cohort = load_cohort(description)
    given = {
        "index": index, "values": cohort.values_of(index), "base": str(cohort.folder),
        "where": cohort.where, "folder": str(patient_folder(folder, index)),
        "start": "first", "starts": 12, "threads": threads, "memory_gb": 8.0,
        "keep_stages": True, "dataset": DatasetSettings(),
        "dataset_folder": str(folder / "dataset"),
    }  # fmt: skip
    return Patient(**(given | changes))


@pytest.fixture(scope="module")
def description(tmp_path_factory) -> Path:
    return describe(tmp_path_factory.mktemp("user"))


@pytest.fixture(scope="module")
def undisturbed(description) -> Path:
    """The patients made one after the other in this process, with one thread."""
    folder = description.parent / "undisturbed"
    for index in range(PATIENTS):
        assert make_patient(task(description, folder, index)).failed == (index == FAULTY)
    return folder


@pytest.fixture(scope="module")
def disturbed(description) -> Path:
    """A cohort whose scheduler is stopped, and then its workers are killed again and again."""
    folder = description.parent / "disturbed"
    cohort = load_cohort(description)
    processes, address = start_cluster(description.parent)
    patient = pytest.MonkeyPatch()
    patient.setattr("mammosim.cohort.cluster.CONNECT_S", 10.0)
    try:
        stop_when(lambda: finished(folder) >= 1, processes[0])
        with pytest.raises(Interrupted, match=r"the scheduler no longer answers"):
            run_cohort(cohort, folder, scheduler=address)
    finally:
        patient.undo()
        for process in processes:
            process.kill()
            process.wait()
    done = threading.Event()
    killer = threading.Thread(target=kill_workers, args=(folder, done, 2))
    killer.start()
    try:
        progress = run_cohort(cohort, folder, workers=2)
    finally:
        done.set()
        killer.join()
    assert (progress.done, progress.failed) == (PATIENTS - 1, 1)
    return folder


def finished(folder: Path) -> int:
    return len(list(folder.glob("patients/*/run.json")))


WAIT_S = 600.0
"""For what takes seconds, on a machine that does other things: it ends a test that would hang."""


def start_cluster(folder: Path) -> tuple[list[subprocess.Popen], str]:
    """A scheduler and a worker with two threads, each a process of its own."""
    note = folder / "scheduler.json"
    ends = ["--scheduler-file", str(note)]
    scheduler = ["distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard", *ends]
    worker = ["distributed.cli.dask_worker", "--nthreads", "2", "--no-nanny", "--no-dashboard",
              "--local-directory", str(folder), *ends]  # fmt: skip
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [
        subprocess.Popen([sys.executable, "-m", *words], **quiet) for words in (scheduler, worker)
    ]
    until = time.monotonic() + WAIT_S
    while True:
        with suppress(OSError, ValueError):  # not there yet, or not wholly written
            return processes, json.loads(note.read_text())["address"]
        assert time.monotonic() < until, "the scheduler did not start"
        time.sleep(0.1)


def stop_when(due, process: subprocess.Popen) -> None:
    def wait() -> None:
        until = time.monotonic() + WAIT_S
        while not due() and time.monotonic() < until:
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()


def kill_workers(folder: Path, done: threading.Event, times: int) -> None:
    """Kill workers at random moments after they have begun with a patient."""
    rng = np.random.default_rng(1)
    while times and not done.is_set():
        busy = [lock for lock in folder.glob("patients/*/.lock") if lock.exists()]
        if busy:
            time.sleep(rng.uniform(0.0, 0.6))
            for lock in busy:
                owner = pid_in(lock)
                if owner is not None and owner != os.getpid() and psutil.pid_exists(owner):
                    os.kill(owner, signal.SIGKILL)
                    times -= 1
                    break
        time.sleep(0.05)


def pid_in(lock: Path) -> int | None:
    try:
        return int(lock.read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return None


def test_a_disturbed_cohort_equals_one_that_nothing_happened_to(undisturbed, disturbed):
    expected, found = data_of(undisturbed), data_of(disturbed)
    found.pop("dataset/manifest.csv")
    assert set(found) - set(expected) <= {f"patients/{FAULTY:06d}/failure.json"}
    assert {name for name in expected if found.get(name) != expected[name]} <= {
        f"patients/{FAULTY:06d}/failure.json"
    }
    assert not list(disturbed.rglob(".part-*"))


def test_threads_make_no_difference(description, undisturbed, tmp_path):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only on this machine")
    for index in (0, 4):
        assert not make_patient(task(description, tmp_path, index, threads=2)).failed
    some = {name: data for name, data in data_of(undisturbed).items()
            if "000000" in name or "000004" in name}  # fmt: skip
    assert data_of(tmp_path) == some


def warnings_in(folder):
    """Warnings in each patient's record."""
    records = {index: patient_folder(folder, index) / "run.json" for index in (0, 1, 2, 4)}
    return {index: json.loads(path.read_text())["warnings"] for index, path in records.items()}


def test_one_tidy_table_and_the_failures(disturbed):
    table = pyarrow.parquet.read_table(disturbed / "table.parquet").to_pylist()
    assert [row["patient"] for row in table] == [0, 0, 1, 1, 2, 2, 4, 4]
    with (disturbed / "table.csv").open(newline="") as stream:
        lines = list(csv.DictReader(stream))
    assert [float(line["dose_mgy"]) for line in lines] == [row["dose_mgy"] for row in table]
    for row in table:
        folder = patient_folder(disturbed, row["patient"])
        view = json.loads((folder / "run.json").read_text())["views"][f"{row['laterality']}CC"]
        assert row["dose_mgy"] == view["dose_mgy"]
        assert row["volumetric_density_percent"] == view["volumetric_density_percent"]
        assert row["phantom.lesions.0.diameter_mm"] in (8, 9, 10, 11)
        assert row["all_seconds"] > 0
    warned = warnings_in(disturbed)
    assert [row["warnings"] for row in table] == [len(warned[row["patient"]]) for row in table]
    listed = list(csv.DictReader((disturbed / "warnings.csv").open(newline="")))
    found = [(int(row["patient"]), text_of_csv(row["warning"])) for row in listed]
    assert found == [(index, text) for index, texts in warned.items() for text in texts]
    failures = list(csv.DictReader((disturbed / "failures.csv").open(newline="")))
    assert [row["patient"] for row in failures] == [str(FAULTY)]
    assert "mass" in failures[0]["reason"]
    page = (disturbed / "summary.html").read_text()
    assert "4 patients, 4 pictures" in page
    assert page.count("<svg ") >= 8
    assert page.count("data:image/jpeg") == 4
    assert not re.search(r'(?:src|href)="http', page)


def test_no_worker_takes_more_memory_than_a_quarter_above_the_estimate(description, disturbed):
    cohort = load_cohort(description)
    for path in disturbed.glob("patients/*/run.json"):
        peak_mb = json.loads(path.read_text())["peak_memory_mb"]
        assert peak_mb < 1.25 * 1e3 * worker_gb(make_plan(cohort.config_of(int(path.parent.name))))


def test_the_data_set_is_split_by_patient_and_its_masks_are_the_runs(disturbed):
    rows = list(csv.DictReader((disturbed / "dataset" / "manifest.csv").open(newline="")))
    assert [row["patient"] for row in rows] == ["0", "1", "2", "4"]
    assert {row["split"] for row in rows} <= {"train", "validation", "test"}
    for row in rows:
        picture = np.array(Image.open(disturbed / "dataset" / row["image"]))
        mask = np.array(Image.open(disturbed / "dataset" / row["mask"]))
        assert picture.dtype == np.uint16
        assert picture.shape == mask.shape
        assert picture.max() > 1000
        assert set(np.unique(mask)) == {0, int(row["lesions"])}


def test_status_tells_what_is_there(disturbed, tmp_path):
    status = cohort_status(disturbed)
    assert (status.progress.done, status.progress.failed, status.active) == (4, 1, False)
    assert list(status.failures) == [FAULTY]
    result = invoke("cohort", "status", disturbed)
    assert result.exit_code == 0
    assert "4 of 5 done, 1 failed, 0 not started; --resume continues" in result.output
    assert f"patient {FAULTY}: " in result.output
    warned = sum(bool(texts) for texts in warnings_in(disturbed).values())
    assert len(status.warnings) == warned
    said = f"{counted(warned, 'patient')} with warnings, see warnings.csv"
    assert (said in " ".join(result.output.split())) == (warned > 0)
    with writing(disturbed):
        assert cohort_status(disturbed).active


def test_two_runs_on_one_cohort(description, disturbed):
    with writing(disturbed):
        result = invoke("cohort", "run", description, "--output", disturbed, "--resume")
    assert result.exit_code == 2
    assert "in use by another run" in result.output
    result = invoke("cohort", "run", description, "--output", disturbed)
    assert result.exit_code == 2
    assert "give --resume" in result.output


def test_a_patient_that_is_there_is_not_made_again(description, disturbed):
    before = (patient_folder(disturbed, 0) / "run.json").stat().st_mtime_ns
    outcome = make_patient(task(description, disturbed, 0))
    assert outcome.found
    assert (patient_folder(disturbed, 0) / "run.json").stat().st_mtime_ns == before


def test_a_file_that_was_damaged_is_made_again(description, undisturbed, tmp_path):
    shutil.copytree(patient_folder(undisturbed, 0), patient_folder(tmp_path, 0))
    picture = next(patient_folder(tmp_path, 0).rglob("mammogram.tif"))
    picture.write_bytes(picture.read_bytes()[:-4] + b"bits")
    assert not make_patient(task(description, tmp_path, 0)).found
    assert picture.read_bytes() == data_of(undisturbed)[f"{picture.relative_to(tmp_path)}"]


def test_a_full_disk_loses_nothing(description, undisturbed, tmp_path):
    """A limit on the size of files stands for a disk that fills up at any of them."""
    whole = {name: data for name, data in data_of(undisturbed).items() if "000000" in name}
    sizes = sorted(map(len, whole.values()))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in (sizes[-1] - 1, sizes[len(sizes) // 2], 100, 0):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            outcome = make_patient(task(description, tmp_path, 0))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert outcome.failed
        assert "cannot be written (" in outcome.reason
        assert not list(tmp_path.rglob(".part-*"))
        for name, data in data_of(tmp_path).items():
            assert name.endswith(("failure.json", "config.yaml")) or (data == whole[name])
    assert not make_patient(task(description, tmp_path, 0)).failed
    assert data_of(tmp_path) == whole


def test_a_read_only_output_is_said_plainly(description, tmp_path):
    output = tmp_path / "locked"
    output.mkdir(mode=0o500)
    words = [sys.executable, "-m", "mammosim", "cohort", "run", str(description), "--output",
             str(output)]  # fmt: skip
    if os.geteuid() == 0:  # root writes anywhere, unless it gives that up
        if shutil.which("setpriv") is None:
            pytest.skip("root, and no setpriv to give up what it may")
        words = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search", *words]
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    assert result.returncode == 2, result.stderr
    assert "cannot be written (Permission denied)" in result.stderr
    assert "Traceback" not in result.stderr
    assert list(output.iterdir()) == []


SCRIPT = """
import os
import sys

from mammosim.cohort import load_cohort, run_cohort

if __name__ == "__main__":
    cohort = load_cohort(sys.argv[1], ["cohort.patients=2"])
    progress = run_cohort(cohort, sys.argv[2], workers=2)
    assert (progress.done, progress.failed) == (2, 0), progress
    assert "NUMBA_NUM_THREADS" not in os.environ
"""


def test_a_script_makes_a_cohort(description, tmp_path):
    """A worker imports what the script does before it learns how many threads it has."""
    script = tmp_path / "cohort_of_mine.py"
    script.write_text(SCRIPT)
    threads = {"NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"}
    environment = {key: value for key, value in os.environ.items() if key not in threads}
    words = [sys.executable, str(script), str(description), str(tmp_path / "out")]
    result = subprocess.run(
        words, capture_output=True, text=True, check=False, env=environment, timeout=WAIT_S
    )
    assert result.returncode == 0, result.stderr


def test_too_little_memory_is_a_failure_of_that_patient(description, tmp_path):
    outcome = make_patient(task(description, tmp_path, 0, memory_gb=0.1))
    assert outcome.failed
    assert "of memory, but a worker has 0.1 GB" in outcome.reason
    note = json.loads((patient_folder(tmp_path, 0) / "failure.json").read_text())
    assert note["kind"] == "InputError"


def test_stages_need_not_be_kept(description, tmp_path):
    assert not make_patient(task(description, tmp_path, 0, keep_stages=False)).failed
    assert not list(tmp_path.rglob("*.npz"))


def test_a_cohort_whose_every_patient_is_faulty_is_refused_before_it_begins(description, tmp_path):
    result = invoke(
        "cohort", "run", description, "--output", tmp_path / "out", "--set",
        "compression.thickness_mm=-3",
    )  # fmt: skip
    assert result.exit_code == 2
    assert "patient 0: compression.thickness_mm: found -3" in result.output
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_goes_before_it_has_a_worker():
    class Client:
        status = "running"

        def nthreads(self):
            self.status = "closed"
            raise OSError("connection lost")

    with pytest.raises(Interrupted, match="never had a worker"):
        wait_for_worker(Client())


def test_a_scheduler_that_is_not_there(description, tmp_path):
    cohort = load_cohort(description)
    with pytest.raises(InputError, match=r"^nonsense://x: no scheduler answers"):
        run_cohort(cohort, tmp_path / "out", scheduler="nonsense://x")


def test_workers_that_do_not_start(monkeypatch):
    def failing(**_):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr("mammosim.cohort.cluster.LocalCluster", failing)
    with pytest.raises(Interrupted, match=r"could not be started \(Nanny failed to start"):
        local_client(Workers(1, 1, 1.0)).__enter__()

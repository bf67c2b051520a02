"""The command in odd surroundings: output closed, full or gone, other locales, little memory."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from make_run import save_breast, write

COMMAND = [sys.executable, "-m", "mammosim"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A phantom and a configuration."""
    folder = save_breast(tmp_path_factory.mktemp("streams"))
    write(folder, views=["CC"], report={"html": False}, export={"dicom": False, "volumes": True})
    return folder


def shell(folder: Path, line: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a line of shell, in which `mammosim` stands for the command."""
    line = line.replace("mammosim", " ".join(COMMAND))
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, capture_output=True, timeout=900, check=False,
        env={**os.environ, **environment}, text=True, errors="backslashreplace",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "status", "said"),
    [("mammosim info breast.npz > /dev/full", 2, "standard output: cannot be written (No space"),
     ("mammosim check run.yaml >&-", 2, "standard output: cannot be written (Bad file"),
     ("mammosim --help > /dev/full", 2, "standard output: cannot be written (No space"),
     ("mammosim info breast.npz | true; exit ${PIPESTATUS[0]}", 0, ""),
     ("mammosim info nowhere.npz 2> /dev/full", 2, ""),
     ("mammosim check run.yaml <&- 2>&-", 0, "")],
)  # fmt: skip
def test_output_that_cannot_be_written(line, status, said, folder):
    done = shell(folder, line)
    assert done.returncode == status, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


@pytest.mark.parametrize(
    ("line", "name"), [("> /dev/full", "full"), ("2>&1 | true", "gone"), (">&- 2>&-", "closed")]
)
def test_a_run_is_done_whoever_listens(line, name, folder):
    done = shell(folder, f"mammosim run run.yaml --output {name} {line}; exit ${{PIPESTATUS[0]}}")
    assert done.returncode == 0, done.stderr
    assert '"status": "done"' in (folder / name / "run.json").read_text()
    assert ("No space left" in done.stderr) == (name == "full")


def test_a_locale_without_utf_8(folder):
    """ITK takes names in UTF-8 only, and ended the process; so do other libraries in C++."""
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell(
        folder, "mammosim convert breast.npz hé.nii.gz && mammosim info hé.nii.gz", **plain
    )
    assert done.returncode == 0, done.stderr
    assert "source: hé.nii.gz" in done.stdout
    done = shell(folder, r"mammosim info $'h\xe9.nii.gz'", **plain)
    assert done.returncode == 2
    assert "is not UTF-8; rename the file or folder" in done.stderr


@pytest.mark.parametrize(
    ("megabytes", "said"),
    [(400, "not enough memory to start"), (1200, "not enough memory: a limit")],
)
def test_little_memory_is_said_in_a_sentence(megabytes, said, folder):
    done = shell(folder, f"ulimit -v {megabytes * 1000}; mammosim run run.yaml --output little")
    assert done.returncode == 2
    assert said in done.stderr
    assert "ulimit -v" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "little").exists()


def test_memory_that_is_lacking_later_is_an_error_too(folder, monkeypatch):
    """As where NumPy finds none in the middle of a stage."""
    from make_run import invoke

    from mammosim import phantom

    def none_left(*_arguments: object) -> None:
        raise MemoryError("Unable to allocate 2.00 GiB")

    monkeypatch.setattr(phantom, "read_phantom", none_left)
    result = invoke("info", folder / "breast.npz")
    assert result.exit_code == 2
    assert "not enough memory (Unable to allocate 2.00 GiB)" in result.output


def test_limits_of_memory_are_known(monkeypatch):
    from mammosim.phantom import memory

    limits = {resource.RLIMIT_AS: (5_000_000_000, -1), resource.RLIMIT_DATA: (-1, -1)}
    monkeypatch.setattr(memory.resource, "getrlimit", limits.get)
    assert memory.address_bytes() == 5_000_000_000
    assert memory.available_bytes() < 5_000_000_000


def test_completion_can_be_installed(folder):
    done = shell(
        folder, "mammosim --show-completion bash; exit $?", HOME=str(folder), SHELL="/bin/bash"
    )
    assert done.returncode == 0, done.stderr
    assert "complete" in done.stdout

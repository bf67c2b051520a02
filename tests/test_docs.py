"""The documentation: its code runs, its pages are built and read without a network."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

from mammosim import load_config
from mammosim.acquisition.scatter import photon_transport
from mammosim.cohort import load_cohort

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted([*DOCS.glob("tutorials/*.md"), *DOCS.glob("how-to/*.md")])
NOTEBOOKS = sorted(DOCS.glob("tutorials/*.ipynb"))
COARSER = {
    "voxel_mm=2.0": "voxel_mm=4.0", '"voxel_mm": 2.0': '"voxel_mm": 4.0',
    "resolution_mm=4.0": "resolution_mm=8.0", '"resolution_mm": 4.0': '"resolution_mm": 8.0',
    "pixel_mm=0.5": "pixel_mm=1.5", '"pixel_mm": 0.5': '"pixel_mm": 1.5',
}  # fmt: skip
AS_PUBLISHED = {"notebook_detectability"}
"""A mass of 6 mm is hardly seen in voxels of 4 mm."""
BLOCK = re.compile(r"^```(\S[^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch):
    """Blocks run one after the other; a block of YAML is saved where later ones look for it."""
    monkeypatch.chdir(tmp_path)
    # What a page leaves out: enough for scatter to be there, in a twentieth of the time.
    monkeypatch.setattr(photon_transport, "PHOTONS", 10_000)
    names: dict[str, object] = {}
    for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "python":
            exec(compile(text, page.name, "exec"), names)
        elif kind == "yaml":
            cohort = text.startswith("cohort:")
            path = tmp_path / ("cohort.yaml" if cohort else "own.yaml")
            path.write_text(text, encoding="utf-8")
            (load_cohort if cohort else load_config)(path)


@pytest.mark.service
@pytest.mark.parametrize("page", NOTEBOOKS, ids=lambda page: page.stem)
def test_the_cells_of_a_notebook_run(page, tmp_path, monkeypatch):
    """With larger voxels, lattice and pixels, where what is asserted does not depend on them."""
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    names: dict[str, object] = {}
    for cell in json.loads(page.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            if page.stem not in AS_PUBLISHED:
                for fine, coarse in COARSER.items():
                    source = source.replace(fine, coarse)
            exec(compile(source, page.name, "exec"), names)
    plt.close("all")


def test_commands_in_the_pages_exist():
    from typer.main import get_command

    from mammosim.cli import app

    commands = get_command(app).commands
    for page in PAGES:
        for kind, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if kind != "console":
                continue
            for line in text.splitlines():
                words = line.split()
                if words[0] != "mammosim":
                    continue
                command = commands[words[1]]
                if words[1] == "cohort":
                    command = command.commands[words[2]]
                known = {option for part in command.params for option in part.opts}
                assert {word for word in words if word.startswith("--")} <= known, line


def test_the_run_that_an_image_is_built_with_is_a_valid_one():
    text = (DOCS / "Dockerfile").read_text(encoding="utf-8")
    changes = re.findall(r"--set (\S+)", text)
    assert len(changes) == text.count("--set") > 0
    config = load_config(DOCS.parent / "configs" / "quickstart.yaml", changes)
    assert config.phantom.generate.voxel_mm >= 1, "quick to build"
    assert config.compression.model == "hyperelastic", "check has those of springs"


def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path):
    pytest.importorskip("mkdocs", reason="pip install mammosim[docs]")
    pytest.importorskip("mkdocstrings_handlers.python", reason="pip install mammosim[docs]")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-f",
             str(DOCS / "site" / "mkdocs.yml"), "-d", str(tmp_path / "site")]  # fmt: skip
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    settings = (tmp_path / "site" / "reference" / "settings.html").read_text()
    for word in ("thickness_mm", "patients_file", "population fit"):
        assert word in settings
    python = (tmp_path / "site" / "reference" / "python.html").read_text()
    assert "generate_phantom" in python
    for page in (tmp_path / "site").rglob("*.html"):
        fetched = re.findall(
            r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)', page.read_text()
        )
        assert not [url for url in fetched if "canonical" not in url], page

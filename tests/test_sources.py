"""Works that are cited are those of the bibliography; the page of sources."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from mammosim.bibliography import works

PAGE = Path(__file__).parents[1] / "docs" / "site" / "sources.py"


@pytest.fixture(scope="module")
def sources():
    spec = importlib.util.spec_from_file_location("sources", PAGE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("met one by one (Siddon 1985, Med Phys 12:252)", ["siddon1985"]),
        ("# CC: 21 kPa\n# (de Groot\n#  et al. 2013)", ["degroot2013"]),
        ('"49 to 186 N (Sullivan et al. "\n    "1991)"', ["sullivan1991"]),
        ("Dance, Young and van Engen (2011)", ["dance2011"]),
        ("of Dance and colleagues (1990, 2000) hold", ["dance1990", "dance2000"]),
        ("Rodriguez-Ruiz et al. 2016", ["rodriguezruiz2016"]),
        ("Hintermüller, Ito & Kunisch 2002", ["hintermuller2002"]),
        ("2400 x 1800 pixels, version 2024.8", []),
    ],
)
def test_forms_of_citation(sources, text, keys):
    found = [candidates[0] for _, candidates in sources.citations(sources.plain(text))]
    assert found == keys


def test_every_citation_is_in_the_bibliography_and_every_entry_is_cited(sources):
    where, unknown = sources.cited()
    assert unknown == []
    assert [key for key in works() if not where.get(key)] == []


def test_the_page_holds_every_work_and_says_what_was_not_confirmed(sources):
    page = sources.sources_page()
    found, rest = page.split("## Not confirmed")
    for work in works().values():
        assert work.citation in (found if work.checked else rest)
        assert not work.numbers or work.checked, work.key
    assert "`mammosim/acquisition/spectrum.py`" in rest.split("## Assumed")[1]


def test_years_of_keys_and_dois():
    for key, work in works().items():
        assert work.title, key
        assert not work.doi or work.doi.startswith("10."), key
    dois = [work.doi for work in works().values() if work.doi]
    assert len(set(dois)) == len(dois)

"""The works that the project cites, from `bibliography.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files


@dataclass(frozen=True)
class Work:
    """One work.

    Parameters
    ----------
    key : str
        Its first author's name and its year, as `boone2000`, or another short name.
    title : str
    authors : str
        Empty if they are not known.
    published : str
        Journal with volume and pages, or publisher; empty if it is not known.
    doi : str
        Digital object identifier; empty where there is none or it is not known.
    checked : str
        Where the entry was looked up, and what of it was not shown there; empty: not yet.
    numbers : str
        Which of the numbers taken from it were seen, and where in it.
    cited_as : tuple of str
        How it is cited where that is not by author and year.
    """

    key: str
    title: str
    authors: str = ""
    published: str = ""
    doi: str = ""
    checked: str = ""
    numbers: str = ""
    cited_as: tuple[str, ...] = ()

    @property
    def citation(self) -> str:
        """Authors, title, where it was published, and the year.

        Examples
        --------
        >>> works()["siddon1985"].citation
        'Siddon RL. Fast calculation of the exact radiological path for a three-dimensional CT \
array. Med Phys 12:252-255, 1985.'
        """
        year = self.key[-4:]
        dated = f", {year}" if year.isdigit() and year not in self.published else ""
        parts = (self.authors, self.title, self.published + dated)
        return "".join(f"{part.strip(' .,')}. " for part in parts if part).rstrip()


@cache
def works() -> dict[str, Work]:
    """Every work by its key, in alphabetical order."""
    text = files("mammosim").joinpath("bibliography.toml").read_text(encoding="utf-8")
    return {
        key: Work(key=key, **{**entry, "cited_as": tuple(entry.get("cited_as", ()))})
        for key, entry in sorted(tomllib.loads(text).items())
    }

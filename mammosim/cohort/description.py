"""A cohort's file: a run's configuration with distributions, and the section `cohort`."""

from __future__ import annotations

import copy
import csv
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from mammosim.cohort.distributions import (
    LEFT_OUT,
    Column,
    Distribution,
    find_distributions,
    stream,
)
from mammosim.cohort.distributions import Path as KeyPath
from mammosim.cohort.settings import MAX_PATIENTS, CohortSettings
from mammosim.config import (
    folder_name,
    open_file,
    read_yaml,
    real_path,
    to_settings,
    user_path,
)
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, apply_change, config_of

SEED_BITS = 53
"""Of a patient's seed: what every table and JSON reader holds exactly; two of 10^5 patients have
the same with a probability of 6e-7."""


@dataclass(frozen=True, eq=False)
class Cohort:
    """A cohort as its file describes it.

    Parameters
    ----------
    title : str
        Name of the file.
    where : str
        The file, for messages.
    folder : Path
        What paths are relative to.
    values : dict
        Plain values of the run's configuration, distributions in their places.
    settings : CohortSettings
    seed : int
        The cohort's, from which each patient's follows.
    distributions : dict of key path to Distribution
    rows : list of dict of str to str
        Lines of the patients' file; empty without one.
    """

    title: str
    where: str
    folder: Path
    values: dict[str, Any]
    settings: CohortSettings
    seed: int
    distributions: dict[KeyPath, Distribution]
    rows: list[dict[str, str]]

    @property
    def patients(self) -> int:
        """Number of patients."""
        return self.settings.patients or len(self.rows)

    def drawn(self, patient: int) -> dict[str, Any]:
        """A patient's values by the key path of their distribution, and the patient's seed.

        They depend on the cohort's seed, the patient's number and the key path alone.
        """
        row: Mapping[str, str] = self.rows[patient] if self.rows else {}
        values = {
            dotted(path): law.draw(stream(self.seed, patient, dotted(path)), row)
            for path, law in self.distributions.items()
        }
        seed = stream(self.seed, patient, "seed").integers(2**SEED_BITS)
        return {**values, "seed": int(seed)}

    def values_of(self, patient: int) -> dict[str, Any]:
        """A patient's configuration as plain values, not checked yet."""
        drawn = self.drawn(patient)
        values: dict[str, Any] = copy.deepcopy(self.values)
        # The last of a list first, so that an entry which is left out moves none before it.
        for path in sorted(self.distributions, key=_order, reverse=True):
            _put(values, path, drawn[dotted(path)])
        values["seed"] = drawn["seed"]
        return values

    def config_of(self, patient: int) -> RunConfig:
        """A patient's configuration.

        Raises
        ------
        InputError
            If what was drawn cannot be used.
        """
        return config_of(self.values_of(patient), self.folder, f"{self.where}, patient {patient}")


def load_cohort(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> Cohort:
    """Read and check a cohort's file.

    Parameters
    ----------
    path : path
        A YAML file, or the `cohort.json` of a cohort's folder.
    changes : sequence of str
        ``section.key=value`` each, in place of what the file says.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    values, folder, title = _read(Path(path))
    for change in changes:
        apply_change(values, change)
    where = str(path)
    section = values.pop("cohort", None)
    if not isinstance(section, dict):
        raise InputError(
            f"{where}: cohort: found {section!r:.60}, expected a section with 'patients'"
        )
    settings = to_settings(CohortSettings, section, where, ("cohort",))
    seed = values.pop("seed", 1)
    if type(seed) is not int or seed < 0:
        raise InputError(f"{where}: seed: found {seed!r:.60}, expected a whole number of 0 or more")
    laws = find_distributions(values, where)
    rows = _patients_file(settings, folder, laws, where)
    return Cohort(title, where, folder, values, settings, seed, laws, rows)


def dotted(path: KeyPath) -> str:
    """A key path as a user writes it."""
    return ".".join(str(key) for key in path)


def _read(path: Path) -> tuple[dict[str, Any], Path, str]:
    """Values, the folder that their paths are relative to, and the cohort's name."""
    values = read_yaml(path)
    if isinstance(values, dict) and {"cohort_of", "folder", "title"} <= values.keys():
        folder, title, values = values["folder"], values["title"], values["cohort_of"]
        if isinstance(values, dict) and isinstance(folder, str):
            return values, Path(folder), folder_name(title, path.stem)
        values = None
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected a mapping with the sections 'cohort' and 'phantom'")
    return values, real_path(path).parent, path.stem


def _patients_file(
    settings: CohortSettings, folder: Path, laws: Mapping[KeyPath, Distribution], where: str
) -> list[dict[str, str]]:
    columns = {dotted(at): law.column for at, law in laws.items() if isinstance(law, Column)}
    if settings.patients_file is None:
        if columns:
            raise InputError(
                f"{where}: {at}: uses column '{column}', but cohort.patients_file is not given"
                for at, column in columns.items()
            )
        return []
    named = user_path(settings.patients_file, f"{where}: cohort.patients_file")
    path = folder / named
    header, rows = _csv_rows(path)
    missing = [(at, column) for at, column in columns.items() if column not in header]
    if missing:
        raise InputError(
            f"{where}: {at}: found no column '{column}' in {path}; it has {', '.join(header)}"
            for at, column in missing
        )
    wanted = settings.patients or len(rows)
    if not 1 <= wanted <= len(rows):
        raise InputError(
            f"{where}: cohort.patients: found {wanted}, but {path} has {len(rows)} lines"
        )
    return rows


def _csv_rows(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    try:
        with TextIOWrapper(open_file(path), "utf-8-sig", newline="") as stream:
            filled = (line for line in csv.reader(stream, strict=True) if line)
            lines = list(islice(filled, MAX_PATIENTS + 2))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as CSV in UTF-8 ({error})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    header = [name.strip() for name in lines[0]] if lines else []
    if not header or len(set(header)) < len(header):
        raise InputError(f"{path}: expected a header with unique column names; found {header}")
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(header):
            raise InputError(
                f"{path}, line {number}: found {len(line)} cells, expected {len(header)}"
            )
    if len(lines) - 1 > MAX_PATIENTS:
        raise InputError(f"{path}: found more than {MAX_PATIENTS} lines, one per patient")
    return header, [dict(zip(header, line, strict=True)) for line in lines[1:]]


def _order(path: KeyPath) -> tuple[str, ...]:
    return tuple(f"{key:09d}" if isinstance(key, int) else key for key in path)


def _put(values: Any, path: KeyPath, value: Any) -> None:
    for key in path[:-1]:
        values = values[key]
    if value is LEFT_OUT:
        del values[path[-1]]
    else:
        values[path[-1]] = copy.deepcopy(value)


def part_of(cohort: Cohort, patient: int) -> str:
    """Part of the data set that a patient is in: train, validation or test."""
    if cohort.settings.dataset is None:
        return ""
    split = cohort.settings.dataset.split
    edges = np.cumsum([split.train, split.validation])
    place = stream(cohort.seed, patient, "split").random()
    return ("train", "validation", "test")[int(np.searchsorted(edges, place, side="right"))]

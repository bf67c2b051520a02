"""Distributions in place of a configuration's values, and what they give for one patient."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.stats import truncnorm

from mammosim.config import Settings, to_settings

Path = tuple[str | int, ...]
"""Keys and list positions from the top of the configuration."""

LEFT_OUT = object()
"""Stands for a key that this patient does not have."""


class Choice(Settings):
    """One of several values."""

    choice: tuple[Any, ...] = Field(min_length=1)
    """The values to choose from, of any type."""

    weights: tuple[float, ...] | None = None
    """Relative weight of each value; default: equal."""

    @model_validator(mode="after")
    def _weights_fit(self) -> Self:
        if self.weights is None:
            return self
        if len(self.weights) != len(self.choice):
            raise ValueError(f"found {len(self.weights)} weights for {len(self.choice)} values")
        if min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ValueError("weights must be 0 or more, and one of them above 0")
        return self

    def draw(self, rng: np.random.Generator, row: Mapping[str, str]) -> Any:
        """One of the values."""
        weights = np.array(self.weights or [1.0] * len(self.choice))
        edges = np.cumsum(weights / weights.max())
        return self.choice[int(np.searchsorted(edges, rng.random() * edges[-1], side="right"))]


class Uniform(Settings):
    """A number from a uniform distribution."""

    uniform: tuple[float, float]
    """Smallest and largest value."""

    decimals: int | None = Field(default=None, ge=0, le=12)
    """Number of decimals kept; 0 gives whole numbers; default: all."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.uniform[0] > self.uniform[1]:
            raise ValueError("the first number must not be above the second")
        return self

    def draw(self, rng: np.random.Generator, row: Mapping[str, str]) -> float | int:
        """A number between the two."""
        low, high = self.uniform
        return _rounded(low + (high - low) * rng.random(), self.decimals)


class Normal(Settings):
    """A number from a normal distribution, truncated if `within` is given."""

    normal: tuple[float, float]
    """Mean and standard deviation before truncation."""

    within: tuple[float, float] | None = None
    """Smallest and largest value, at which the distribution is truncated."""

    decimals: int | None = Field(default=None, ge=0, le=12)
    """Number of decimals kept; 0 gives whole numbers; default: all."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.normal[1] <= 0:
            raise ValueError("the standard deviation must be above 0")
        if self.within is not None and self.within[0] >= self.within[1]:
            raise ValueError("within: the first number must be below the second")
        return self

    def draw(self, rng: np.random.Generator, row: Mapping[str, str]) -> float | int:
        """A number of the distribution; one random number makes it, cut off or not."""
        mean, deviation = self.normal
        low, high = self.within or (-np.inf, np.inf)
        a, b = (low - mean) / deviation, (high - mean) / deviation
        with np.errstate(over="ignore"):
            value = float(truncnorm.ppf(rng.random(), a, b, loc=mean, scale=deviation))
        return _rounded(min(max(value, low), high), self.decimals)


class Column(Settings):
    """The value in a column of the patients' file."""

    column: str
    """Name of the column; with an empty cell, the key is not set."""

    def draw(self, rng: np.random.Generator, row: Mapping[str, str]) -> Any:
        """The patient's cell: a number, true or false, or text."""
        return _cell(row[self.column])


Distribution = Choice | Uniform | Normal | Column
KINDS: dict[str, type[Distribution]] = {
    "choice": Choice, "uniform": Uniform, "normal": Normal, "column": Column,
}  # fmt: skip
"""Distributions by the key that marks them."""


def find_distributions(values: Any, where: str, at: Path = ()) -> dict[Path, Distribution]:
    """Distributions in a configuration's plain values, by their key path.

    Raises
    ------
    InputError
        If one is not complete; with file and key path.
    """
    if isinstance(values, dict):
        kind = next((KINDS[key] for key in KINDS if key in values), None)
        if kind is not None:
            return {at: to_settings(kind, values, where, tuple(map(str, at)))}
        items: Any = values.items()
    elif isinstance(values, list):
        items = enumerate(values)
    else:
        return {}
    found: dict[Path, Distribution] = {}
    for key, value in items:
        found.update(find_distributions(value, where, (*at, key)))
    return found


def stream(seed: int, patient: int, purpose: str) -> np.random.Generator:
    """Random numbers of one patient and purpose, whatever else is drawn, and in what order.

    Parameters
    ----------
    seed : int
        The cohort's.
    patient : int
        Number of the patient, from 0.
    purpose : str
        What they are for, as ``compression.thickness_mm``.
    """
    words = np.frombuffer(hashlib.sha256(purpose.encode()).digest()[:8], "<u4")
    key = (patient, *(int(word) for word in words))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def _rounded(value: float, decimals: int | None) -> float | int:
    if decimals is None or not np.isfinite(value):  # infinity is refused where it is used
        return value
    return round(value) if decimals == 0 else round(value, decimals)


def _cell(text: str) -> Any:
    text = text.strip()
    if not text:
        return LEFT_OUT
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text

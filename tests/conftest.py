"""Fixtures that several files of tests use."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import replace

import pytest

from mammosim.phantom import BreastPhantom, generate_phantom

_made: dict[str, BreastPhantom] = {}


@pytest.fixture(autouse=True, scope="session")
def sigint_interrupts() -> Iterator[None]:
    """Give SIGINT the handler that Python gives it at a terminal, here and in tests' processes.

    A shell ignores SIGINT in what it starts in the background, and Python leaves it so.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def breasts_are_made_once(monkeypatch) -> None:
    """A breast that a run in this process generated before is copied, for tests of other things."""

    def copied(settings, *, seed, laterality):
        key = f"{settings.model_dump_json()} {seed} {laterality}"
        if key not in _made:
            _made[key] = generate_phantom(settings, seed=seed, laterality=laterality)
        return replace(_made[key], labels=_made[key].labels.copy())

    monkeypatch.setattr("mammosim.phantom.make.generate_phantom", copied)

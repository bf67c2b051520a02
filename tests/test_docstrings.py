"""The examples in docstrings give what they say."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import mammosim

ELSEWHERE = ("mammosim.__main__", "mammosim.serve.")
"""Begins when it is imported; needs an extra."""


def test_examples_in_docstrings(capsys):
    """All in one test: a module's examples take a few milliseconds."""
    runner = doctest.DocTestRunner()
    for module in pkgutil.walk_packages(mammosim.__path__, "mammosim."):
        if not module.name.startswith(ELSEWHERE):
            for example in doctest.DocTestFinder().find(importlib.import_module(module.name)):
                runner.run(example)
    assert runner.failures == 0, capsys.readouterr().out
    assert runner.tries > 60

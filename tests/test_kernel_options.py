"""Numba's options of a kernel, compared in one step: what was equal is, and nothing else."""

import pytest
from numba.core.compiler import Flags

import mammosim._jit  # noqa: F401, it is what is tested

SWITCHES = [name for name, option in Flags.options.items() if option.type is bool]


def test_there_are_switches_to_compare():
    assert {"release_gil", "no_cfunc_wrapper", "nrt"} <= set(SWITCHES)


@pytest.mark.parametrize("name", SWITCHES)
def test_options_are_equal_where_all_their_values_are(name):
    usual = Flags()
    said, other = usual.copy(), usual.copy()
    setattr(said, name, Flags.options[name].default)
    setattr(other, name, not Flags.options[name].default)
    assert said == usual
    assert hash(said) == hash(usual)
    assert usual.copy() == usual
    assert other == other.copy()
    assert other != usual
    assert said != other


def test_options_equal_nothing_else():
    assert Flags() != {}
    assert Flags() != Flags().values()

"""Limits beyond which a result is doubtful."""

import math

import pytest

from mammosim.plausibility import LIMITS, plausibility_warnings


@pytest.mark.parametrize("limit", LIMITS, ids=lambda limit: limit.quantity)
def test_each_limit_lets_its_range_through_and_says_what_leaves_it(limit):
    inside = [value for value in (limit.low, limit.high) if math.isfinite(value)]
    assert inside, "a limit that limits nothing"
    for value in inside:
        assert plausibility_warnings({limit.quantity: value}) == ()
    if math.isfinite(limit.low):
        (warning,) = plausibility_warnings({limit.quantity: limit.low - 1e-3})
        assert warning.severity == "warning"
        assert f"plausible from {limit.low:g}" in str(warning)
    (warning,) = plausibility_warnings({limit.quantity: math.nextafter(limit.high, math.inf)})
    assert warning.severity == ("error" if limit.error_above == limit.high else "warning")
    if math.isfinite(limit.error_above):
        (warning,) = plausibility_warnings({limit.quantity: limit.error_above * 1.01 + 1.0})
        assert warning.severity == "error"
        assert limit.name in str(warning)
        assert limit.advice in str(warning)


def test_what_is_no_number_is_no_result():
    (warning,) = plausibility_warnings({"paddle_force_n": math.nan})
    assert warning.severity == "error"
    assert "found nan, expected a number" in str(warning)


def test_limits_name_their_source():
    assert all(limit.source for limit in LIMITS)
    assert len({limit.quantity for limit in LIMITS}) == len(LIMITS)


def test_a_quantity_without_a_limit_is_a_mistake_of_the_caller():
    with pytest.raises(KeyError, match="no plausibility limit for thickness"):
        plausibility_warnings({"thickness": 1.0})

"""Checks: what is in range comes back as it is, whatever else is a ConfigError with its name."""

import doctest
import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring import checks
from deepring.errors import ConfigError, DeepringError

ANY = (
    st.none()
    | st.booleans()
    | st.integers(-5, 5)
    | st.floats()
    | st.text(max_size=3)
    | st.lists(st.integers(), max_size=3)
)


def real(value):
    """Whether a value is a finite number, told another way than `is_number` does."""
    return type(value) in (int, float) and abs(value) < math.inf


RULES = [
    (checks.number, real),
    (checks.positive, lambda v: real(v) and v > 0),
    (lambda name, value: checks.at_least(name, value, -2), lambda v: real(v) and v >= -2),
    (checks.count, lambda v: type(v) is int and v >= 1),
    (lambda name, value: checks.count(name, value, 0), lambda v: type(v) is int and v >= 0),
    (checks.share, lambda v: real(v) and 0 <= v <= 1),
    (checks.fraction, lambda v: real(v) and 0 < v < 1),
    (lambda name, value: checks.one_of(name, value, (1, "a")), lambda v: v in (1, "a")),
]


@pytest.mark.parametrize(("check", "right"), RULES)
@given(value=ANY)
def test_a_value_comes_back_or_is_named(check, right, value):
    if right(value) and not isinstance(value, bool):
        assert check("reach", value) is value
    else:
        with pytest.raises(ConfigError) as raised:
            check("reach", value)
        assert str(raised.value).startswith(f"reach: {value!r}, expected ")


@given(st.lists(ANY, max_size=3) | st.tuples(ANY, ANY) | ANY)
def test_an_interval_is_two_rising_numbers(value):
    pair = value if isinstance(value, list | tuple) else ()
    if len(pair) == 2 and all(map(real, pair)) and pair[0] < pair[1]:
        assert checks.interval("height", value) == tuple(value)
    else:
        with pytest.raises(ConfigError, match=r"^height: .*, expected \[low, high\] in metres"):
            checks.interval("height", value, "metres")


def test_choices_may_be_a_literal_a_mapping_or_a_set():
    for choices in (Literal["l2", "cosine"], {"l2": 1, "cosine": 2}, {"l2", "cosine"}):
        assert checks.one_of("metric", "cosine", choices) == "cosine"
        for wrong in ("l1", ["l2"], {"l2": 1}, None, np.zeros(2)):
            with pytest.raises(ConfigError, match=r"^metric: "):
                checks.one_of("metric", wrong, choices)
    with pytest.raises(ConfigError, match="'l1', expected one of l2, cosine"):
        checks.one_of("metric", "l1", Literal["l2", "cosine"])


def test_true_is_not_one():
    with pytest.raises(ConfigError, match=r"^pool: True, expected one of 1, 2"):
        checks.one_of("pool", True, (1, 2))


def test_units_are_named():
    for check in (checks.number, checks.positive, lambda *given: checks.at_least(*given[:2], 0)):
        with pytest.raises(ConfigError):
            check("spacing", math.nan)
    with pytest.raises(ConfigError, match="a number of metres above 0"):
        checks.positive("spacing", 0, "metres")
    with pytest.raises(ConfigError, match=r"a number of metres of at least 0\.5"):
        checks.at_least("spacing", 0.1, 0.5, "metres")


def test_numpy_values_of_settings_are_told_like_any_other():
    assert checks.positive("reach", np.float64(2.0)) == 2.0
    with pytest.raises(ConfigError):
        checks.count("candidates", np.float64(2.0))


def test_errors_are_value_errors_of_ours():
    assert issubclass(ConfigError, DeepringError)
    with pytest.raises(ValueError, match="reach"):
        checks.positive("reach", -1)


def test_the_examples_are_right():
    failed, tried = doctest.testmod(checks)
    assert failed == 0
    assert tried >= 9

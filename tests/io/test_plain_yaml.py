"""YAML of anybody: plain values, or one error; and what it stands for, counted without copying."""

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DataError
from deepring.io.plain_yaml import expanded_size, plain_yaml

BOMB = "a: &a [1]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefg", "bcdefgh", strict=True)
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: [", "invalid YAML at line 2"),
        ("a: !!python/object/apply:os.getcwd []", "invalid YAML at line 1"),
        ("a: !!timestamp x", "invalid YAML at some line"),
        ("a: !!int 9e9", "invalid YAML at some line"),
        ("[" * 5000, "invalid YAML at some line"),
        (b"\xff\xfe\x00", "invalid YAML at some line"),
        (BOMB, "aliases that stand for more than 100000 values"),
        ("&a [*a]", "aliases that stand for more than 100000 values"),
    ],
)
def test_what_is_not_plain_is_one_error(text, said):
    with pytest.raises(DataError, match=f"^{said}"):
        plain_yaml(text)


leaves = st.none() | st.booleans() | st.integers() | st.text(max_size=3)
values = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=20,
)


def counted(value):
    """By writing everything out."""
    if isinstance(value, dict):
        return 1 + sum(1 + counted(each) for each in value.values())
    return 1 + sum(map(counted, value)) if isinstance(value, list) else 1


@settings(deadline=None, derandomize=True)
@given(values)
def test_without_aliases_all_values_are_counted(value):
    assert expanded_size(value) == counted(value)


@pytest.mark.parametrize("levels", [1, 3, 30])
def test_aliases_of_aliases_count_as_often_as_they_stand_there(levels):
    value = 0
    for _ in range(levels):
        value = [value] * 10
    assert expanded_size(value) == sum(10**k for k in range(levels + 1))


def test_a_value_within_itself_has_no_end():
    assert expanded_size(yaml.safe_load("&a [1, *a]")) == math.inf
    assert expanded_size(yaml.safe_load("{a: &a {b: *a}}")) == math.inf

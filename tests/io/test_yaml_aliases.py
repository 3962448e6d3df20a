"""What a YAML text stands for is counted without writing it out."""

import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.io.yaml_aliases import expanded_size

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

"""Plain values against types: what JSON gives back becomes what was written, or is named."""

import json
import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.checks import positive
from deepring.errors import ConfigError
from deepring.io.typed import field_values, typed


@dataclass(frozen=True)
class Inner:
    size: float
    mode: Literal["a", "b"] = "a"

    def __post_init__(self) -> None:
        positive("size", self.size)


@dataclass(frozen=True)
class Outer:
    name: str
    count: int
    flag: bool
    pair: tuple[int, float]
    many: tuple[float, ...]
    texts: list[str]
    inner: Inner | None
    by_name: dict[str, Inner]
    anything: dict[str, Any]


number = st.floats(allow_nan=False, allow_infinity=False)
inner = st.builds(Inner, number.filter(lambda value: value > 0), st.sampled_from("ab"))
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | number | st.text(max_size=5),
    lambda some: st.lists(some, max_size=3) | st.dictionaries(st.text(max_size=3), some),
    max_leaves=5,
)
outer = st.builds(
    Outer,
    st.text(),
    st.integers(),
    st.booleans(),
    st.tuples(st.integers(), number),
    st.lists(number, max_size=3).map(tuple),
    st.lists(st.text(max_size=3), max_size=3),
    st.none() | inner,
    st.dictionaries(st.text(max_size=3), inner, max_size=2),
    st.dictionaries(st.text(max_size=3), json_values, max_size=2),
)


@given(outer)
def test_written_as_json_and_typed_again_it_is_the_same(value):
    again = typed(Outer, json.loads(json.dumps(value, default=field_values)), "header")
    assert again == value
    assert isinstance(again.pair, tuple)
    assert isinstance(again.many, tuple)


EXAMPLE = Outer("a", 1, True, (1, 2.0), (1.0,), ["x"], Inner(1.0), {"k": Inner(2.0)}, {})
PLAIN = json.loads(json.dumps(asdict(EXAMPLE)))


@given(st.sampled_from(sorted(PLAIN)), json_values)
def test_any_other_value_is_taken_as_its_type_or_refused(name, value):
    try:
        again = typed(Outer, {**PLAIN, name: value}, "header")
    except ConfigError:
        return
    # Whatever is accepted is written as the same JSON; but 1 and 1.0 are one number.
    assert json.loads(json.dumps(again, default=field_values)) == {**PLAIN, name: value}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": 1}, r"header\.name: 1, expected text"),
        ({"count": 1.0}, r"header\.count: 1\.0, expected a whole number"),
        ({"count": True}, r"header\.count: True, expected a whole number"),
        ({"flag": 1}, r"header\.flag: 1, expected true or false"),
        ({"pair": [1]}, r"header\.pair: \[1\], expected a list of 2"),
        ({"pair": [1, True]}, r"header\.pair\[1\]: True, expected a number"),
        ({"many": [1.0, 10**400]}, r"header\.many\[1\]: 1000"),
        ({"texts": "abc"}, r"header\.texts: 'abc', expected a list"),
        ({"inner": {"size": 0, "mode": "a"}}, "size: 0.0, expected a number above 0"),
        ({"inner": {"size": 1, "mode": "c"}}, r"header\.inner\.mode: 'c', expected one of a, b"),
        ({"inner": {"size": 1}}, r"header\.inner: lacks mode; expected size, mode"),
        (
            {"by_name": {"k": {"size": 1, "mode": "a", "x": 1}}},
            r"by_name\.k\.x: unknown, expected one of size, mode",
        ),
        ({"anything": {3: 1}}, r"header\.anything: {3: 1}, expected values by name"),
        ({"anything": [1]}, r"header\.anything: \[1\], expected values by name"),
        ({"more": 1, "other": 2}, r"header\.more: unknown, expected one of name, count"),
    ],
)
def test_what_does_not_fit_is_named(change, message):
    with pytest.raises(ConfigError, match=message):
        typed(Outer, {**PLAIN, **change}, "header")


def test_long_values_are_cut_in_messages():
    with pytest.raises(ConfigError) as raised:
        typed(int, "x" * 10_000, "value")
    assert len(str(raised.value)) < 200


def test_infinity_and_nan_are_numbers_that_settings_have_to_refuse():
    assert typed(float, math.inf, "value") == math.inf
    with pytest.raises(ConfigError, match="size: inf"):
        typed(Inner, {"size": math.inf, "mode": "a"}, "value")


def test_only_dataclasses_have_field_values():
    with pytest.raises(TypeError):
        field_values(3)

"""Settings of plain values: they come back as they went, and what does not fit names its key."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.errors import ConfigError
from deepring.methods.network import PlainSettings


@dataclass(frozen=True)
class Inner(PlainSettings):
    widths: Sequence[int] = (4, 8)
    mode: Literal["full", "half"] = "full"


@dataclass(frozen=True)
class Outer(PlainSettings):
    count: int = 3
    share: float | None = 0.5
    name: str = "a"
    turned: bool = False
    pair: tuple[float, float] = (0.0, 1.0)
    raster: dict[str, Any] = field(default_factory=dict)
    inner: Inner = Inner()


VALUES = st.fixed_dictionaries(
    {},
    optional={
        "count": st.integers(),
        "share": st.none() | st.floats(allow_nan=False) | st.integers(-(2**53), 2**53),
        "name": st.text(),
        "turned": st.booleans(),
        "pair": st.lists(st.floats(allow_nan=False), min_size=2, max_size=2),
        "raster": st.dictionaries(st.text(), st.integers() | st.lists(st.integers())),
        "inner": st.fixed_dictionaries(
            {},
            optional={
                "widths": st.lists(st.integers()),
                "mode": st.sampled_from(["full", "half"]),
            },
        ),
    },
)


@given(VALUES)
def test_what_is_stated_comes_back_and_the_rest_is_the_default(values):
    settings = Outer.from_dict(values)
    plain = settings.to_dict()
    default = Outer().to_dict()
    inner = {**default["inner"], **values.get("inner", {})}
    assert plain == {**default, **values, "inner": inner}
    assert Outer.from_dict(json.loads(json.dumps(plain))) == settings


def test_lists_and_tuples_make_equal_settings():
    assert Inner([1, 2]) == Inner((1, 2)) == Inner.from_dict({"widths": [1, 2]})
    assert hash(Inner([1, 2])) == hash(Inner((1, 2)))
    assert Outer(inner=Inner([1])) == Outer.from_dict({"inner": {"widths": (1,)}})


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"cuont": 3}, r"net\.cuont: unknown, expected one of count, share, name, turned, pair"),
        ({"inner": {"wdths": []}}, r"net\.inner\.wdths: unknown, expected one of widths, mode"),
        ({"inner": 3}, r"net\.inner: 3, expected values by name: widths, mode"),
        ({"count": 3.0}, r"net\.count: 3\.0, expected a whole number"),
        ({"count": True}, r"net\.count: True, expected a whole number"),
        ({"count": None}, r"net\.count: None, expected a whole number"),
        ({"share": "half"}, r"net\.share: 'half', expected a number or null"),
        ({"share": False}, r"net\.share: False"),
        ({"name": 3}, r"net\.name: 3, expected text"),
        ({"turned": 1}, r"net\.turned: 1, expected true or false"),
        ({"pair": [0.0]}, r"net\.pair: \[0\.0\], expected a list of 2"),
        ({"raster": []}, r"net\.raster: \[\], expected values by name"),
        ({"inner": {"widths": 8}}, r"net\.inner\.widths: 8, expected a list"),
        ({"inner": {"widths": [8, "x"]}}, r"net\.inner\.widths\[1\]: 'x', expected a whole number"),
        ({"inner": {"mode": "third"}}, r"net\.inner\.mode: 'third', expected one of full, half"),
        ([], r"net: \[\], expected values by name"),
    ],
)
def test_what_does_not_fit_names_its_key(values, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Outer.from_dict(values, "net")

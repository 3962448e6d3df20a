"""JSON that every program reads alike: the library's own values, and nothing else."""

import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.errors import DataError
from deepring.io.strict_json import DEPTH, read_json

WHOLE = st.integers(-(2**63) + 1, 2**63 - 1)
values = st.recursive(
    st.none()
    | st.booleans()
    | WHOLE
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5),
    lambda some: st.lists(some, max_size=3) | st.dictionaries(st.text(max_size=3), some),
    max_leaves=6,
)


@given(values, st.booleans())
def test_values_come_back(value, ascii_alone):
    text = json.dumps(value, ensure_ascii=ascii_alone)
    assert read_json(text) == value
    assert str(read_json(text)) == str(value)  # -0.0 and 0.0, 1 and 1.0, True and 1 differ


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "none"),
        ("{", "none"),
        ("[1] 2", "none"),
        ("{'a': 1}", "none"),
        ('{"a": 1, "b": {"c": 1, "c": 1}}', "'c' twice"),
        ("[NaN]", "NaN, expected finite"),
        ("-Infinity", "-Infinity, expected finite"),
        ("[1e999]", "'1e999', expected finite"),
        ("-1e999", "expected finite"),
        ("9223372036854775808", "64 bits"),
        ("9" * 5000, "64 bits"),
        ("[" * (DEPTH + 1) + "]" * (DEPTH + 1), "nested too deeply"),
        ("[" * 100_000, "nested too deeply|none"),
        ('{"a":' * 100_000, "nested too deeply|none"),
        (b"\xff\xfe\xfd", "none"),
    ],
)
def test_what_programs_read_in_several_ways_is_refused(text, message):
    with pytest.raises(DataError, match=message) as raised:
        read_json(text)
    assert len(str(raised.value)) < 200


def test_many_names_are_compared_in_short_time():
    text = "{" + ",".join(f'"{k}": 0' for k in range(100_000)) + ', "0": 1}'
    start = time.process_time()
    with pytest.raises(DataError, match="'0' twice"):
        read_json(text)
    assert time.process_time() - start < 2

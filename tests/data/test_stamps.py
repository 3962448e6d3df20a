"""Stamps stay whole nanoseconds, through text and files."""

from decimal import Decimal

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from deepring.data.poses.pose_tables import read_table, stamped_rows
from deepring.data.poses.stamps import nanoseconds_of, seconds_text
from deepring.errors import FileError

INT64 = st.integers(-(2**63), 2**63 - 1)
STAMP = 1566279795718079314


@settings(derandomize=True)
@given(INT64)
@example(STAMP)
@example(-(2**63))
@example(-1)
def test_a_written_stamp_is_read_as_it_was(stamp):
    text = seconds_text(np.int64(stamp))
    assert nanoseconds_of(text) == stamp
    assert Decimal(text) * 10**9 == stamp  # an independent reading


@settings(derandomize=True)
@given(st.decimals(-9_000_000_000, 9_000_000_000, allow_nan=False, places=9), st.integers(-30, 30))
def test_any_notation_is_exact(value, exponent):
    """With as many digits before or after the point, and whatever exponent."""
    stamp = int(value * 10**9)
    sign, digits, power = value.as_tuple()
    integer = int("".join(map(str, digits)))
    shifted = f"{'-' if sign else ''}{integer}e{power}"
    assert nanoseconds_of(shifted) == stamp
    assert nanoseconds_of(f"{value:f}") == stamp
    assert nanoseconds_of(f"{value.scaleb(exponent):f}e{-exponent}") == stamp


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("1566279795.718079314", STAMP),
        ("1566279795", 1566279795 * 10**9),
        ("1.5e9", 1_500_000_000 * 10**9),
        ("+1.036224e-01", 103_622_400),
        (" .5 ", 500_000_000),
        ("5.", 5 * 10**9),
        ("-0.000000001", -1),
        ("0.0000000005", 0),  # half to even
        ("0.0000000015", 2),
        ("0.00000000149999999999999999999999999999999999999999", 1),
        ("1e-999999", 0),
        ("0e999999", 0),
    ],
)
def test_decimals_are_exact(text, stamp):
    assert nanoseconds_of(text) == stamp
    assert isinstance(nanoseconds_of(text), int)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "no number"),
        (".", "no number"),
        ("e5", "no number"),
        ("nan", "no number"),
        ("inf", "no number"),
        ("1_000", "no number"),
        ("0x10", "no number"),
        ("1,5", "no number"),
        ("١", "no number"),
        ("1566279795718079314", "would be nanoseconds"),
        ("1566279795718079.314", "would be microseconds"),
        ("1566279795718", "would be milliseconds"),
        ("9223372036.854775808", "out of range"),
        ("1e999999", "out of range"),
        ("1" * 5000, "out of range"),
        ("-" + "1" * 5000, "out of range"),
    ],
)
def test_other_text_is_refused_with_the_reason(text, reason):
    with pytest.raises(ValueError, match=reason):
        nanoseconds_of(text)


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.lists(INT64, min_size=1, max_size=20))
def test_a_table_of_seconds_holds_whole_nanoseconds(tmp_path_factory, stamps):
    path = tmp_path_factory.mktemp("tables") / "drive.tum"
    path.write_text("".join(f"{seconds_text(stamp)} 1 2\n" for stamp in stamps))
    rows = read_table(path, stamped_rows(2), None, "a time and 2 numbers", seconds=True)
    assert rows["stamp"].tolist() == stamps
    # The counter-example: a double has no nanoseconds left at the time of the epoch.
    assert int(float(seconds_text(STAMP)) * 1e9) != STAMP


def test_nanoseconds_in_a_column_of_seconds_are_refused_with_their_line(tmp_path):
    path = tmp_path / "drive.tum"
    path.write_text(f"{STAMP} 1 2\n")
    with pytest.raises(
        FileError, match=rf"line 1 .*{STAMP} would be nanoseconds, expected seconds"
    ):
        read_table(path, stamped_rows(2), None, "a time and 2 numbers", seconds=True)

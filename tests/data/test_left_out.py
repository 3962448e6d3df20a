"""Scans that cannot be used give way to the next, are counted and said; too many are an error."""

import logging
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.data.left_out import MOST, LeftOut, usable_scans
from deepring.data.session import Session
from deepring.data.spacing import sample_by_distance
from deepring.errors import BrokenScanError, ConfigError, DataError


def drive(positions):
    """A session of scans at these metres along x."""
    n = len(positions)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = positions
    files = tuple(f"{k}.bin" for k in range(n))
    return Session("drive", files, poses, poses[:, :2, 3].copy(), None, read=None)


def used(session, spacing, broken, left_out=None, progress=None):
    """Numbers of the scans that are used, where those in ``broken`` cannot be."""

    def use(k):
        if k in broken:
            raise BrokenScanError(f"{session.files[k]}: nothing in it")
        return 10 * k

    scans = list(usable_scans(session, spacing, use, left_out, progress))
    assert all(value == 10 * k for k, value in scans)
    return [k for k, _ in scans]


steps = st.lists(st.floats(0, 4), min_size=1, max_size=60)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(steps=steps, spacing=st.sampled_from([0.0, 1.0, 5.0]))
def test_without_broken_scans_they_are_those_sampled_by_distance(steps, spacing):
    session = drive(np.cumsum(steps))
    left_out, seen = LeftOut(), []
    every = np.ones(len(session), dtype=bool)
    expected = sample_by_distance(session.positions, spacing, every).tolist()
    assert used(session, spacing, (), left_out, lambda *counts: seen.append(counts)) == expected
    assert (len(left_out), left_out.total, str(left_out)) == (0, len(expected), "")
    assert seen == [(k + 1, len(expected)) for k in range(len(expected))]


@settings(derandomize=True, max_examples=150, deadline=None)
@given(steps=steps, broken=st.sets(st.integers(0, 59), max_size=12), data=st.data())
def test_those_used_lie_apart_and_no_usable_one_is_missed(steps, broken, data):
    session = drive(np.cumsum(steps))
    spacing = data.draw(st.sampled_from([0.0, 1.0, 5.0]))
    left_out = LeftOut()
    try:
        scans = used(session, spacing, broken, left_out)
    except DataError:
        assert left_out.missed > max(1, MOST * left_out.total) or broken >= set(range(len(steps)))
        return
    x = session.positions[:, 0]
    assert not set(scans) & broken
    assert all(abs(x[b] - x[a]) > spacing or spacing == 0 for a, b in pairwise(scans))
    # Any other whole scan lies within the spacing of the last used one before it, if there is one.
    for k in set(range(len(steps))) - broken - set(scans):
        last = max(scan for scan in scans if scan < k)
        assert abs(x[k] - x[last]) <= spacing
    assert left_out.missed <= max(1, MOST * left_out.total)


def test_the_next_scan_takes_the_place_of_a_broken_one():
    session = drive(np.arange(0, 100, 1.0))
    left_out = LeftOut()
    scans = used(session, 9.5, {0, 11, 12}, left_out)
    assert scans == [1, 13, 23, 33, 43, 53, 63, 73, 83, 93]
    assert len(left_out) == 3
    assert str(left_out) == (
        "session drive: left out 2 of 10 scans that cannot be used, and 1 near by, tried in "
        "their place; first: 0.bin: nothing in it"
    )


def test_a_gap_counts_by_its_length_and_not_by_its_scans():
    """The sensor fails for 90 of 1000 m: nine places of 100, though a hundred scans are tried."""
    session = drive(np.arange(0, 1000, 1.0))
    left_out = LeftOut()
    used(session, 9.5, set(range(500, 590)), left_out)
    assert len(left_out) >= 80
    assert left_out.missed == 9


@pytest.mark.parametrize("spacing", [0.0, 9.5])
def test_a_fifth_may_be_left_out_and_no_more(spacing):
    session = drive(np.arange(0, 1000, 10.0))
    used(session, spacing, set(range(0, 100, 5)))
    left_out = LeftOut()
    with pytest.raises(DataError) as raised:
        used(session, spacing, set(range(0, 100, 4)), left_out)
    assert str(raised.value) == (
        "session drive: 21 or more of 100 scans cannot be used, expected at most 20%; first: "
        "0.bin: nothing in it"
    )
    assert len(left_out) == 21  # it stops there


def test_one_broken_scan_never_stops_the_work_and_none_usable_does():
    assert used(drive([0.0, 10.0]), 5.0, {0}) == [1]
    with pytest.raises(DataError, match="2 or more of 3 scans cannot be used"):
        used(drive([0.0, 10.0, 20.0]), 5.0, {0, 2})
    with pytest.raises(DataError, match=r"none of 2 scans can be used; first: 0\.bin: nothing"):
        used(drive([0.0, 1.0]), 5.0, {0, 1})
    with pytest.raises(DataError, match="session drive: 0 scans"):
        used(drive([]), 5.0, ())
    with pytest.raises(ConfigError, match="spacing: -1"):
        used(drive([0.0]), -1, ())


def test_they_are_logged_where_nobody_else_says_them(caplog):
    caplog.set_level(logging.WARNING)
    used(drive([0.0, 10.0]), 5.0, {0})
    assert [record.getMessage() for record in caplog.records] == [
        "session drive: left out 1 of 2 scans that cannot be used; first: 0.bin: nothing in it"
    ]
    caplog.clear()
    used(drive([0.0, 10.0]), 5.0, {0}, LeftOut())
    used(drive([0.0, 10.0]), 5.0, ())
    assert not caplog.records


def test_other_errors_are_not_the_scans():
    with pytest.raises(ZeroDivisionError):
        list(usable_scans(drive([0.0]), 5.0, lambda k: 1 / k))

"""Consecutive scans joined by odometry: in the last one's frame, and only if they overlap."""

import sys

import numpy as np
import pytest

from deepring.data.scans.point_times import TimedPoints
from deepring.errors import BrokenScanError, ConfigError
from deepring.localization.accumulation import Accumulator
from helpers.scenes import scattered

STEPS = 6


def walls(seed=0):
    """Points (n, 3) of scattered walls, dense enough for an odometry."""
    return scattered(seed, n=12_000)


def seen(world, x, heading, width=np.pi):
    """What a sensor at (x, 0) sees within a sector, and which of the world's points that is."""
    c, s = np.cos(heading), np.sin(heading)
    moved = world - np.float32([x, 0, 1.0])
    frame = np.column_stack([moved @ [c, s, 0], moved @ [-s, c, 0], moved[:, 2]])
    inside = np.abs(np.arctan2(frame[:, 1], frame[:, 0])) < width / 2
    return frame[inside].astype(np.float32), inside


def drive(world):
    return [seen(world, 0.8 * k, 0.05 * k) for k in range(STEPS)]


def test_past_scans_are_joined_in_the_frame_of_the_last():
    world = walls()
    accumulator = Accumulator(3)
    scans = drive(world)
    for k, (points, _) in enumerate(scans):
        joined = accumulator.join(TimedPoints(points, None))
        taken = scans[max(0, k - 2) : k + 1]
        assert len(joined) == sum(len(part) for part, _ in taken)
        np.testing.assert_array_equal(joined[-len(points) :], points)
        # Where each of the points is for the last sensor, by the true motion.
        c, s = np.cos(0.05 * k), np.sin(0.05 * k)
        parts = np.concatenate([world[inside] for _, inside in taken]) - [0.8 * k, 0, 1.0]
        true = np.column_stack([parts @ [c, s, 0], parts @ [-s, c, 0], parts[:, 2]])
        off = np.linalg.norm(joined - true, axis=1)
        assert np.percentile(off, 99) < 0.3
    assert accumulator.interruptions == 0
    # The misreading: the frame of the first of them.
    first, _ = seen(world, 0.8 * (STEPS - 3), 0.05 * (STEPS - 3))
    assert np.median(np.linalg.norm(joined[: len(first)] - first, axis=1)) > 1


def test_scans_that_do_not_overlap_are_joined_with_none():
    accumulator = Accumulator(4)
    for points, _ in drive(walls()):
        accumulator.join(TimedPoints(points, None))
    strange, _ = seen(walls(9), 0.0, 0.0)
    np.testing.assert_array_equal(accumulator.join(TimedPoints(strange, None)), strange)
    assert accumulator.interruptions == 1
    after, _ = seen(walls(9), 0.5, 0.0)
    assert len(accumulator.join(TimedPoints(after, None))) == len(strange) + len(after)


def test_a_scan_without_enough_points_leaves_the_others():
    accumulator = Accumulator(2)
    first, second = (points for points, _ in drive(walls())[:2])
    accumulator.join(TimedPoints(first, None))
    with pytest.raises(BrokenScanError, match="expected at least"):
        accumulator.join(TimedPoints(first[:20], None))
    assert len(accumulator.join(TimedPoints(second, None))) == len(first) + len(second)


def test_what_is_asked_is_checked(monkeypatch):
    with pytest.raises(ConfigError, match="accumulate"):
        Accumulator(0)
    monkeypatch.setitem(sys.modules, "kiss_icp.kiss_icp", None)
    with pytest.raises(ConfigError, match=r"pip install 'deepring\[odometry\]'"):
        Accumulator(2)

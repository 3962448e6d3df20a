"""Times of points, as drivers write them: in their units, after the stamp or of a clock."""

from types import SimpleNamespace

import numpy as np
import pytest

from deepring.data.scans.bag_files import bag_scans
from deepring.data.scans.point_times import point_times
from helpers.bags import START, message, write_bag

STAMP = 1_567_496_784_952_532_897
OFFSETS = np.linspace(-0.02, 0.0801, 40)  # seconds

CODES = {"f4": 7, "f8": 8, "u4": 6, "i4": 5, "u2": 4}


def timed(values, form, name="t", big=False, returns=None):
    """A message whose points have a field of these values, and the mask of its returns."""
    cloud = message(np.random.default_rng(0).normal(size=(len(values), 3)), big=big, after=8)
    raw = cloud.data.reshape(len(values), 20).copy()
    kind = np.dtype(form).newbyteorder(">" if big else "<")
    raw[:, 12 : 12 + kind.itemsize] = np.asarray(values).astype(kind)[:, None].view(np.uint8)
    cloud.data = raw.ravel()
    cloud.fields.append(SimpleNamespace(name=name, offset=12, datatype=CODES[form], count=1))
    return cloud, np.ones(len(values), bool) if returns is None else returns


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    ("name", "form", "values", "off"),
    [
        ("t", "u4", (OFFSETS - OFFSETS[0]) * 1e9, OFFSETS - OFFSETS[0]),  # Ouster
        ("time", "f4", OFFSETS, OFFSETS),  # Velodyne, also before the stamp
        ("timestamp", "f8", STAMP * 1e-9 + OFFSETS, OFFSETS),  # Hesai, a clock's seconds
        ("timestamp", "f8", STAMP + OFFSETS * 1e9, OFFSETS),  # Livox, a clock's nanoseconds
        ("offset_time", "i4", OFFSETS * 1e6, OFFSETS),  # microseconds
    ],
)
def test_times_are_seconds_from_the_stamp(name, form, values, off, big):
    found = point_times(*timed(values, form, name, big), STAMP)
    np.testing.assert_allclose(found, off, atol=2e-6)


def test_only_returns_count():
    values = OFFSETS.copy()
    values[::2] = 1e9  # of missing returns
    returns = np.arange(40) % 2 == 1
    found = point_times(*timed(values, "f8", "time", returns=returns), STAMP)
    np.testing.assert_allclose(found, OFFSETS[1::2], atol=1e-6)


@pytest.mark.parametrize(
    ("values", "form", "name"),
    [
        (OFFSETS, "f4", "intensity"),  # no time at all
        (np.full(40, 0.05), "f4", "time"),  # the same for all points
        (OFFSETS * 1e4, "f4", "time"),  # no sweep in any unit
        (STAMP * 1e-9 + 3600 + OFFSETS, "f8", "timestamp"),  # of another clock
        (np.where(OFFSETS > 0, np.nan, 1.0), "f4", "time"),
    ],
)
def test_what_are_no_times_is_left_out(values, form, name):
    assert point_times(*timed(values, form, name), STAMP) is None


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_bag_gives_points_with_their_times(tmp_path, kind):
    cloud, _ = timed((OFFSETS - OFFSETS[0]) * 1e9, "u4")
    path = write_bag(tmp_path, kind, {"/points": [cloud, message(np.ones((3, 3)))]})
    first, second = (scan.timed() for scan in bag_scans(path))
    assert len(first.points) == 40
    np.testing.assert_allclose(first.times, OFFSETS - OFFSETS[0], atol=1e-8)
    assert second.times is None
    assert [scan.stamp for scan in bag_scans(path)] == [START, START + 10**8]

"""PointCloud2 messages, beside a reader that unpacks one number at a time."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.data.scans.point_cloud2 import cloud_points
from deepring.errors import BrokenScanError
from helpers.bags import message

POINTS = np.random.default_rng(0).normal(0, 20, (12, 3)).astype(np.float32)


def unpacked(cloud):
    """The finite points other than (0, 0, 0), by the definition of the message."""
    data, found = cloud.data.tobytes(), []
    letters = {7: "f", 8: "d"}
    for row in range(cloud.height):
        for column in range(cloud.width):
            start = row * cloud.row_step + column * cloud.point_step
            point = []
            for field in cloud.fields:
                code = (">" if cloud.is_bigendian else "<") + letters[field.datatype]
                point.append(struct.unpack_from(code, data, start + field.offset)[0])
            if all(math.isfinite(value) for value in point) and point != [0, 0, 0]:
                found.append(point)
    return np.array(found, np.float32).reshape(-1, 3)


@given(
    st.lists(st.tuples(*[st.floats(width=32)] * 3), max_size=6),
    st.integers(1, 3),
    st.sampled_from([4, 8]),
    st.booleans(),
    st.tuples(*[st.integers(0, 9)] * 3),
)
def test_it_is_what_unpacking_number_by_number_gives(row, rows, width, big, padding):
    before, after, row_padding = padding
    points = np.array(row * rows, np.float64).reshape(-1, 3)
    cloud = message(points, width, big, before, after, row_padding, rows)
    found = cloud_points(cloud)
    assert found.dtype == np.float32
    assert np.array_equal(found, unpacked(cloud))


def test_points_without_a_return_are_dropped():
    holes = POINTS.copy()
    holes[3], holes[7, 1], holes[8] = np.nan, np.inf, 0
    kept = np.delete(POINTS, [3, 7, 8], axis=0)
    assert np.array_equal(cloud_points(message(holes, rows=3)), kept)
    beyond = POINTS.astype(np.float64)
    beyond[[3, 7, 8]] = 1e300  # no float32
    assert np.array_equal(cloud_points(message(beyond, width=8)), kept)


def test_fields_of_any_order_and_kind_of_float():
    cloud = message(POINTS, after=8)
    cloud.fields[0].name, cloud.fields[2].name = "z", "x"
    assert np.array_equal(cloud_points(cloud), POINTS[:, ::-1])
    raw = np.zeros(2, {"names": ["x", "y", "z"], "formats": ["<f8", "<f4", "<f8"]})
    raw["x"], raw["y"], raw["z"] = 1.5, 2.5, -3.5
    cloud = message(np.zeros((2, 3)), after=8)
    cloud.data = raw.view(np.uint8)
    for field, offset, datatype in zip(cloud.fields, (0, 8, 12), (8, 7, 8), strict=True):
        field.offset, field.datatype = offset, datatype
    assert np.array_equal(cloud_points(cloud), [[1.5, 2.5, -3.5]] * 2)


def test_one_row_may_leave_its_step_out():
    cloud = message(POINTS)
    cloud.row_step = 0
    assert np.array_equal(cloud_points(cloud), POINTS)


def test_what_is_no_cloud_of_points_says_so():
    cloud = message(POINTS)
    cloud.fields[2].name = "range"
    with pytest.raises(
        BrokenScanError, match=r"x \(type 7\), y \(type 7\), range \(type 7\); expected x, y and z"
    ):
        cloud_points(cloud)
    cloud = message(POINTS)
    cloud.fields[1].datatype = 5
    with pytest.raises(BrokenScanError, match=r"y \(type 5\).*expected x, y and z of type 7"):
        cloud_points(cloud)
    cloud = message(POINTS)
    cloud.fields[2].offset = 10
    with pytest.raises(
        BrokenScanError, match="at bytes 0, 4, 10; expected them within the 12 bytes"
    ):
        cloud_points(cloud)
    cloud = message(POINTS)
    cloud.data = cloud.data[:-1]
    with pytest.raises(BrokenScanError, match="143 bytes in rows of 144; expected 1 rows of 12"):
        cloud_points(cloud)
    cloud = message(POINTS, rows=2)
    cloud.row_step = 60
    with pytest.raises(
        BrokenScanError, match="144 bytes in rows of 60; expected 2 rows of 6 points of 12"
    ):
        cloud_points(cloud)

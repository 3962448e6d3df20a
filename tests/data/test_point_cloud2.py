"""PointCloud2 messages, beside a reader that unpacks one number at a time."""

import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.data.scans.point_cloud2 import cloud_records
from deepring.errors import BrokenScanError
from helpers.bags import message

POINTS = np.random.default_rng(0).normal(0, 20, (12, 3)).astype(np.float32)


def unpacked(cloud):
    """All records, by the definition of the message."""
    data, found = cloud.data.tobytes(), []
    letters = {7: "f", 8: "d"}
    for row in range(cloud.height):
        for column in range(cloud.width):
            start = row * cloud.row_step + column * cloud.point_step
            point = []
            for field in cloud.fields:
                code = (">" if cloud.is_bigendian else "<") + letters[field.datatype]
                point.append(struct.unpack_from(code, data, start + field.offset)[0])
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
    found = cloud_records(cloud)
    assert found.dtype == np.float32
    assert np.array_equal(found, unpacked(cloud), equal_nan=True)


def test_missing_returns_are_kept_as_they_are():
    holes = POINTS.copy()
    holes[3], holes[7, 1], holes[8] = np.nan, np.inf, 0
    assert np.array_equal(cloud_records(message(holes, rows=3)), holes, equal_nan=True)
    beyond = POINTS.astype(np.float64)
    beyond[3] = 1e300  # no float32
    assert np.isinf(cloud_records(message(beyond, width=8))[3]).all()


def test_fields_of_any_order_and_kind_of_float():
    cloud = message(POINTS, after=8)
    cloud.fields[0].name, cloud.fields[2].name = "z", "x"
    assert np.array_equal(cloud_records(cloud), POINTS[:, ::-1])
    raw = np.zeros(2, {"names": ["x", "y", "z"], "formats": ["<f8", "<f4", "<f8"]})
    raw["x"], raw["y"], raw["z"] = 1.5, 2.5, -3.5
    cloud = message(np.zeros((2, 3)), after=8)
    cloud.data = raw.view(np.uint8)
    for field, offset, datatype in zip(cloud.fields, (0, 8, 12), (8, 7, 8), strict=True):
        field.offset, field.datatype = offset, datatype
    assert np.array_equal(cloud_records(cloud), [[1.5, 2.5, -3.5]] * 2)


def test_one_row_may_leave_its_step_out():
    cloud = message(POINTS)
    cloud.row_step = 0
    assert np.array_equal(cloud_records(cloud), POINTS)


def test_a_count_of_zero_is_one():
    cloud = message(POINTS)
    for field in cloud.fields:
        field.count = 0
    assert np.array_equal(cloud_records(cloud), POINTS)


def test_an_empty_cloud_has_no_points():
    assert cloud_records(message(POINTS[:0])).shape == (0, 3)


@pytest.mark.parametrize("step", [2**31, 2**32 - 1])
def test_a_point_of_gigabytes_is_refused(step):
    cloud = message(POINTS)
    cloud.point_step = step
    with pytest.raises(BrokenScanError, match=f"{step} bytes for each point; expected at most"):
        cloud_records(cloud)


@pytest.mark.parametrize(
    ("index", "name", "value", "words"),
    [
        (2, "name", "range", r"'x' \(1 × type 7, FLOAT32\), .*expected one x, y and z"),
        (1, "name", "x", "expected one x, y and z each"),
        (1, "datatype", 5, "type 5, INT32.*expected one x, y and z each, of type 7"),
        (1, "datatype", 3, "type 3, INT16"),
        (1, "datatype", 99, "type 99, unknown"),
        (1, "count", 3, "3 × type 7"),
        (2, "offset", 10, "at bytes 0, 4, 10; expected them .* within the 12 bytes"),
        (2, "offset", 2**32 - 4, "within the 12 bytes"),
        (2, "offset", -4, "within the 12 bytes"),
        (2, "offset", 5, "one beside another"),
        (2, "offset", 4, "one beside another"),
    ],
)
def test_fields_that_are_no_coordinates_are_refused(index, name, value, words):
    cloud = message(POINTS)
    setattr(cloud.fields[index], name, value)
    with pytest.raises(BrokenScanError, match=words):
        cloud_records(cloud)


@pytest.mark.parametrize(
    ("rows", "change"),
    [
        (1, {"data": slice(-1)}),
        (1, {"width": 7}),  # five points would be lost
        (1, {"width": 7, "row_step": 144}),
        (1, {"width": 0}),
        (1, {"height": 0}),
        (2, {"row_step": 60}),
        (2, {"height": 1, "row_step": 72}),
        (2, {"height": 3}),
        (1, {"point_step": 16}),
        (2, {"width": 2**31, "height": 2**31}),
        (1, {"height": 2**32 - 1, "width": 1, "row_step": 2**32 - 1}),
    ],
)
def test_sizes_that_the_data_does_not_have_are_refused(rows, change):
    cloud = message(POINTS, rows=rows)
    for name, value in change.items():
        setattr(cloud, name, cloud.data[value] if name == "data" else value)
    words = r"\d+ bytes (in rows of \d+|for each point); expected \d*"
    tracemalloc.start()
    try:
        with pytest.raises(BrokenScanError, match=words):
            cloud_records(cloud)
        assert tracemalloc.get_traced_memory()[1] < 10**6
    finally:
        tracemalloc.stop()

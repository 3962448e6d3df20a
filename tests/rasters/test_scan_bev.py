"""The quick way from a scan to its image is the slow one, cell by cell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.errors import DeepringError
from deepring.rasters import Preprocessing
from deepring.rasters.bev import bev_occupancy, scan_to_bev


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 5000),
    st.sampled_from([None, 0.0, 0.5]),
    st.sampled_from([(70.0, 70.0), (70.0, 40.0), (30.0, 30.0)]),
    st.sampled_from([2, 33, 120]),
    st.floats(-3, 3),
    st.integers(0, 999),
)
def test_one_go_marks_the_cells_of_two(n, clearance, extents, cells, ground_z, seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-80, 80, (n, 3)).astype(np.float32)
    points[:, 2] = rng.normal(ground_z, 4, n)
    preprocessing = Preprocessing(clearance=clearance, extent=extents[0], cell=2.5)
    expected = bev_occupancy(preprocessing(points, ground_z), extents[1], cells)
    found = scan_to_bev(points, ground_z, preprocessing, extents[1], cells)
    assert found.dtype == np.bool_
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("clearance", [None, 0.5])
def test_borders_and_numbers_that_are_none_stay_outside(clearance):
    edge, below = np.float32(70), np.nextafter(np.float32(70), np.float32(0))
    line = [edge, -edge, below, -below, 0.0, np.nan, np.inf, -np.inf, 1e30]
    points = np.array([(x, y, z) for x in line for y in line for z in (0.0, 5.0, np.nan)])
    points = points.astype(np.float32)
    preprocessing = Preprocessing(clearance=clearance)
    expected = bev_occupancy(preprocessing(points, 0.0))
    assert np.array_equal(scan_to_bev(points, 0.0, preprocessing), expected)
    whole = bev_occupancy(preprocessing(points, 0.0), disc=False)
    assert whole[60, 60]


def test_points_may_carry_more_than_three_numbers():
    points = np.random.default_rng(0).normal(0, 20, (500, 5)).astype(np.float32)
    preprocessing = Preprocessing()
    assert np.array_equal(
        scan_to_bev(points, 0.0, preprocessing), scan_to_bev(points[:, :3], 0.0, preprocessing)
    )
    with pytest.raises(DeepringError, match=r"points: shape \(7,\)"):
        scan_to_bev(points[0, :7].repeat(2)[:7], 0.0, preprocessing)

"""Cylindrical voxels: a brute-force count, the seam of θ, the order, and what is refused."""

import math

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters.voxels import PADDING, cylindrical_voxels, sectors_of
from helpers.scenes import scattered


def by_hand(points, degrees, ring, height):
    """One point at a time, in Python's own floats."""
    cells = set()
    for x, y, z in points.tolist():
        turned = math.degrees(math.atan2(y, x)) + 180
        sector = math.floor(turned / degrees) % round(360 / degrees)
        cells.add((sector, math.floor(math.hypot(x, y) / ring), math.floor(z / height)))
    return sorted(cells)


@pytest.mark.parametrize("steps", [(1.0, 0.3, 0.2), (0.9375, 1.5, 2.0), (45.0, 10.0, 0.1)])
def test_the_voxels_are_those_of_a_loop_over_the_points_in_order(steps):
    points = scattered(0)
    voxels = cylindrical_voxels(points, *steps)
    assert voxels.dtype == np.int16
    assert voxels.tolist() == [list(cell) for cell in by_hand(points, *steps)]


def test_the_order_and_number_of_the_points_do_not_matter():
    points = scattered(0)
    shuffled = np.random.default_rng(1).permutation(np.concatenate([points, points[:50]]))
    assert np.array_equal(cylindrical_voxels(shuffled), cylindrical_voxels(points))


def test_sectors_count_counter_clockwise_from_behind_and_close():
    axes = np.array([[-5, -0.01, 0], [0.01, -5, 0], [5, 0.01, 0], [-0.01, 5, 0], [-5, 0, 0]])
    sectors = [cylindrical_voxels(p[None].astype(np.float32))[0, 0] for p in axes]
    assert sectors == [0, 90, 180, 270, 0]


def test_layers_below_the_sensor_are_negative_and_not_doubled_at_zero():
    points = np.array([[3, 0.1, -0.05], [3, 0.1, 0.05]], dtype=np.float32)
    assert cylindrical_voxels(points)[:, 2].tolist() == [-1, 0]


def test_a_turn_by_whole_sectors_shifts_theta_around_the_circle():
    # Points in the middle of their sectors, so that rounding does not move them across an edge.
    azimuth = np.radians(np.arange(0, 360, 7) + 0.5)
    points = np.stack([20 * np.cos(azimuth), 20 * np.sin(azimuth), azimuth], axis=1)
    points = points.astype(np.float32)
    turned = cylindrical_voxels(turn_points(points, math.radians(30)).astype(np.float32))
    expected = cylindrical_voxels(points).astype(int)
    expected[:, 0] = (expected[:, 0] + 30) % 360
    assert sorted(turned.tolist()) == sorted(expected.tolist())


def test_an_empty_scan_has_no_voxels():
    voxels = cylindrical_voxels(np.empty((0, 3), dtype=np.float32))
    assert (voxels.shape, voxels.dtype) == ((0, 3), np.int16)


@pytest.mark.parametrize("bad", [[np.nan, 0, 0], [0, 0, np.inf], [1e6, 0, 0], [1, 0, -1e5]])
def test_points_that_no_index_can_name_are_refused(bad):
    points = np.array([[1, 2, 0], bad], dtype=np.float32)
    with pytest.raises(DeepringError, match=r"points: 2 points.*32768"):
        cylindrical_voxels(points)
    assert PADDING == -32768


@pytest.mark.parametrize("degrees", [0.0, -1.0, 0.7, 361.0, math.nan])
def test_a_step_that_does_not_divide_the_turn_is_refused(degrees):
    with pytest.raises(DeepringError, match=r"voxels\.degrees.*divides 360"):
        cylindrical_voxels(scattered(0), degrees=degrees)


def test_sectors_of_the_usual_steps():
    assert [sectors_of(d) for d in (1.0, 0.5, 0.9375, 360)] == [360, 720, 384, 1]


@pytest.mark.parametrize("name", ["ring", "height"])
@pytest.mark.parametrize("value", [0.0, -0.2, math.inf, math.nan])
def test_other_bad_steps_are_named(name, value):
    with pytest.raises(DeepringError, match=rf"voxels\.{name}"):
        cylindrical_voxels(scattered(0), **{name: value})

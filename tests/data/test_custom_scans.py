"""Scans of custom drives: turned z up without mirroring, cropped of what should not be seen."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.data.readers.custom.custom_scans import UP, CustomScans
from deepring.data.scans.returns import scan_from
from deepring.errors import BrokenScanError
from deepring.rasters import BevRaster

PLAIN = CustomScans(format=None, up="z", sensor_height=1.5)


def scan(n=2000, seed=0):
    """Points around a sensor 1.5 m above the ground; no symmetry."""
    points = np.random.default_rng(seed).normal([3, 1, 0.5], [20, 9, 2], (n, 3))
    return points.astype(np.float32)


@pytest.fixture
def reading(tmp_path):
    """Points as a reader gives them of a file that holds the points given."""

    def read(reader, points):
        np.save(tmp_path / "scan.npy", points)
        return scan_from(reader(tmp_path / "scan.npy"), "scan").points

    return read


def axis(name):
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name.startswith("-") else 1)


@pytest.mark.parametrize("up", UP)
def test_each_turn_is_right_handed_and_brings_its_axis_up(up):
    assert np.linalg.det(UP[up]) == 1
    np.testing.assert_array_equal(UP[up] @ axis(up), [0, 0, 1])
    kept = "y" if up[-1] == "x" else "x"
    np.testing.assert_array_equal(UP[up] @ axis(kept), axis(kept))


@pytest.mark.parametrize("up", UP)
def test_a_sensor_mounted_otherwise_sees_the_same(up, reading):
    points = scan()
    as_stored = points @ UP[up].astype(np.float32)  # UP[up] @ stored is z up
    bands = {"z_band": (0.5, 6), "azimuth": (-100, 120), "range": (2, 30)}
    for reader in (PLAIN, replace(PLAIN, **bands)):
        upright, found = reading(reader, points), reading(replace(reader, up=up), as_stored)
        np.testing.assert_array_equal(found, upright)
        images = [BevRaster()(seen, -1.5) for seen in (upright, found)]
        assert images[0].any()
        np.testing.assert_array_equal(*images)


def test_turning_z_alone_would_mirror_the_scan(reading):
    points = scan()
    upside_down = points * np.float32([1, -1, -1])
    mirrored = upside_down * np.float32([1, 1, -1])
    right = reading(replace(PLAIN, up="-z"), upside_down)
    np.testing.assert_array_equal(right, points)
    one, other = (BevRaster()(seen, -1.5) for seen in (right, mirrored))
    assert (one != other).any()


def test_heights_are_above_the_ground_and_not_the_sensor(reading):
    column = np.float32([[5, 0, z] for z in np.arange(-3, 4, 0.5)])
    kept = reading(replace(PLAIN, z_band=(0.0, 2.0)), column)
    np.testing.assert_array_equal(kept[:, 2], [-1.5, -1, -0.5, 0, 0.5])


def test_ranges_are_from_the_sensor(reading):
    points = np.float32([[1, 0, 0], [0, 3, 4], [6, 0, 8], [0, 0, 11]])
    np.testing.assert_array_equal(
        reading(replace(PLAIN, range=(2, 10)), points), [[0, 3, 4], [6, 0, 8]]
    )


@pytest.mark.parametrize(
    ("azimuth", "kept"),
    [
        ((-45, 45), [0]),
        ((45, 135), [90]),
        ((135, 225), [180]),  # across 180°, where the angle jumps
        ((-225, -135), [180]),
        ((90, 270), [90, 180, 270]),
        ((-180, 180), [0, 90, 180, 270]),
        ((0, 360), [0, 90, 180, 270]),
    ],
)
def test_azimuths_run_counter_clockwise_from_x(azimuth, kept, reading):
    around = {0: [1, 0, 0], 90: [0, 1, 0], 180: [-1, 0, 0], 270: [0, -1, 0]}
    found = reading(replace(PLAIN, azimuth=azimuth), np.float32(list(around.values())))
    np.testing.assert_array_equal(found, [around[degrees] for degrees in kept])


@given(
    low=st.floats(-720, 720),
    width=st.floats(1, 360),
    angle=st.floats(-720, 720),
    turns=st.integers(-2, 2),
)
def test_a_sector_is_the_same_a_whole_turn_on(low, width, angle, turns):
    inside = (angle - low) % 360
    if min(abs(inside - width), inside, 360 - inside) < 1e-3:
        return  # on an edge
    at = np.radians(angle)
    point = np.array([[30 * np.cos(at), 30 * np.sin(at), 0]], dtype=np.float64)
    for first in (low, low + 360 * turns):
        sector = replace(PLAIN, azimuth=(first, first + width))
        assert sector._inside(point)[0] == (inside < width)


def test_missing_returns_are_dropped_and_nothing_left_is_a_broken_scan(reading):
    points = np.float32([[0, 0, 0], [np.nan, 1, 1], [np.inf, 0, 0], [1, 2, 3]])
    np.testing.assert_array_equal(reading(PLAIN, points), [[1, 2, 3]])
    with pytest.raises(BrokenScanError, match=r"scan\.npy: 3 records, all missing returns"):
        reading(PLAIN, points[:3])
    with pytest.raises(BrokenScanError, match=r"1 points, none within z_band, azimuth and range"):
        reading(replace(PLAIN, range=(50, 60)), points)


def test_a_crop_counts_no_point_as_missing(tmp_path):
    np.save(tmp_path / "a.npy", np.float32([[0, 0, 0], [np.nan, 1, 1], [1, 2, 3], [30, 0, 0]]))
    scan = scan_from(replace(PLAIN, range=(2, 10))(tmp_path / "a.npy"), "a")
    np.testing.assert_array_equal(scan.points, [[1, 2, 3]])
    assert scan.missing == 2

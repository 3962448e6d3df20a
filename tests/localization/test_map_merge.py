"""Two maps of two drives in frames of their own, put together."""

import math

import numpy as np
import pytest

from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.readers.nclt import open_nclt
from deepring.errors import DataError
from deepring.localization.candidates import RerankSettings
from deepring.localization.map import Map
from deepring.localization.map_merge import find_frame, merged
from deepring.methods.deepring import DeepRing
from deepring.rasters import BevRaster, Preprocessing, raster_settings
from helpers.networks import deepring_settings, small_network
from helpers.scenes import scattered

#: World <- frame of the second map.
MOVED = pose_from(rotation_from_rpy(0.0, 0.0, 2.0), [40.0, -30.0, 5.0])

#: The second sensor sits this much higher.
HIGHER = 0.4


@pytest.fixture(scope="module")
def maps(tiny_nclt):
    drives = [open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17")]
    # The network is not trained: what it takes for alike is little better than chance.
    rerank = RerankSettings(candidates=100)
    made = []
    for drive, pose, higher in zip(drives, (np.eye(4), MOVED), (0.0, HIGHER), strict=True):
        place_map = Map(small_network(), -higher, rerank=rerank, points=True)
        rows = range(0, len(drive.files), 2)
        scans = [drive.points(k) - np.float32([0, 0, higher]) for k in rows]
        sensors = np.linalg.inv(pose) @ drive.poses[list(rows)]
        sensors[:, 2, 3] += higher  # the drives are level but for a small tilt
        place_map.add(scans, sensors, [f"{k}" for k in rows])
        made.append(place_map)
    return (*made, drives[1])


@pytest.fixture(scope="module")
def frame(maps):
    first, second, _ = maps
    return find_frame(first, second)


def test_the_frame_of_a_second_drive_is_found(frame):
    assert frame.agreeing >= 0.9 * frame.located >= 0.5 * frame.tried
    assert math.hypot(*(frame.pose[:2, 3] - MOVED[:2, 3])) < 1.0
    assert abs(frame.pose[2, 3] - MOVED[2, 3]) < 0.3
    assert abs(float(yaw_of(frame.pose[:3, :3] @ MOVED[:3, :3].T))) < math.radians(1)
    assert frame.error < 1.0


def test_the_merged_map_answers_for_both(maps, frame):
    first, second, drive = maps
    both = merged(first, second, frame, "b/")
    assert len(both) == len(both.points) == len(first) + len(second)
    assert both.places.names[len(first) :] == [f"b/{name}" for name in second.places.names]
    np.testing.assert_array_equal(both.places.poses[: len(first)], first.places.poses)
    for row, k in enumerate(range(0, len(drive.files), 2)):
        place = len(first) + row
        moved = both.places.poses[place]
        assert np.linalg.norm(moved[:3, 3] - drive.poses[k][:3, 3]) < 1.0
        # Points and pose belong together, as high above the ground as the first map's.
        middles = [points.mean(axis=0) for points in (both.points.of(place), second.points.of(row))]
        np.testing.assert_allclose(middles[0] - middles[1], [0, 0, HIGHER], atol=0.15)
    location = both.localize(drive.points(3))
    assert math.hypot(*(drive.positions[3] - [location.x, location.y])) < 2.0


def test_a_merged_map_keeps_points_if_both_do(maps, frame):
    first, second, _ = maps
    points = second.points
    try:
        second.points = None
        assert merged(first, second, frame).points is None
        assert first.points is not None
    finally:
        second.points = points


def test_maps_of_different_places_are_refused(maps):
    first, _, _ = maps
    other = Map(small_network())
    scans = [scattered(k) for k in range(12)]
    poses = np.tile(np.eye(4), (12, 1, 1))
    poses[:, 0, 3] = 30.0 * np.arange(12)
    other.add(scans, poses, [f"{k}" for k in range(12)])
    with pytest.raises(DataError, match=r"of 12 places of the second are found in the first; .*"):
        find_frame(first, other)
    with pytest.raises(DataError, match="holds no places"):
        find_frame(first, Map(small_network()))


def test_images_of_another_raster_are_refused(maps):
    first, _, _ = maps
    raster = raster_settings(BevRaster(preprocessing=Preprocessing(clearance=1.0)))
    other = Map(DeepRing(deepring_settings(raster, pool=2, widths=(4, 8), convolutions=1)))
    with pytest.raises(DataError, match=r"second: its images are of .*clearance=1\.0"):
        find_frame(first, other)

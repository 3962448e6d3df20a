"""The whole pose of a scan in a map: right in any world; doubts that are told."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.errors import ConfigError, DataError
from deepring.localization.map import Map
from deepring.localization.registration.refinement import RefinementSettings
from helpers.networks import small_network

NETWORK = small_network()


def town(seed=0):
    """Ground, walls and poles in the world (n, 3), metres, ground at z = 0."""
    rng = np.random.default_rng(seed)
    parts = [rng.uniform([-45, -45, 0], [45, 45, 0], (30000, 3))]
    for x, y, heading, length in ((0, 14, 0.05, 50), (5, -11, -0.1, 40), (28, 2, 1.5, 25)):
        along, up = rng.uniform(-length / 2, length / 2, 6000), rng.uniform(0, 7, 6000)
        parts.append(np.c_[x + along * math.cos(heading), y + along * math.sin(heading), up])
    return np.concatenate(parts) + rng.normal(0, 0.02, (48000, 3))


def seen(pose, seed=0):
    """The town in the frame of a sensor at a pose."""
    return ((town(seed) - pose[:3, 3]) @ pose[:3, :3]).astype(np.float32)


def sensor(x, y, yaw, z=1.8, roll=0.0, pitch=0.0):
    return pose_from(rotation_from_rpy(roll, pitch, yaw), [x, y, z])


WORLD = pose_from(rotation_from_rpy(0, 0, 2.0), [4.1e5, -5.2e6, 300.0])
PLACES = [sensor(0, 0, 0.3), sensor(8, 1, -1.0, roll=0.02), sensor(-9, 2, 3.0, pitch=0.03)]
QUERY = sensor(2.0, -1.0, 1.2, roll=0.03, pitch=-0.02)


def map_of(world, ground_z=-1.8):
    place_map = Map(NETWORK, ground_z, points=True)
    poses = np.stack([world @ pose for pose in PLACES])
    place_map.add([seen(pose, k) for k, pose in enumerate(PLACES)], poses, ["a", "b", "c"])
    return place_map


def found(place_map, points, world, off=(0.6, -0.4, 0.05), **options):
    """The scan refined from a location near its true one."""
    truth = world @ QUERY
    location = place_map.localize(points, **options)
    near = replace(location, place=0, name="a", x=truth[0, 3] + off[0], y=truth[1, 3] + off[1],
                   yaw=math.atan2(truth[1, 0], truth[0, 0]) + off[2],
                   trusted=True, doubt=None)  # fmt: skip
    return place_map.refine(points, near, **options)


@pytest.mark.parametrize("world", [np.eye(4), WORLD])
def test_the_whole_pose_is_right_in_any_world(world):
    refined, truth = found(map_of(world), seen(QUERY, 9), world), world @ QUERY
    assert refined.converged
    assert refined.doubt is None
    assert refined.unobservable_names == []
    assert np.linalg.norm(refined.pose[:3, 3] - truth[:3, 3]) < 0.02
    turn = Rotation.from_matrix(truth[:3, :3].T @ refined.pose[:3, :3])
    assert turn.magnitude() < math.radians(0.1)
    np.testing.assert_allclose(
        rotation_from_rpy(*refined.roll_pitch_yaw), refined.pose[:3, :3], atol=1e-9
    )
    assert (refined.x, refined.y, refined.z) == tuple(refined.pose[:3, 3])


def test_the_covariance_turns_with_the_world():
    turn = pose_from(rotation_from_rpy(0, 0, 1.1), np.zeros(3))
    one = found(map_of(np.eye(4)), seen(QUERY, 9), np.eye(4), off=(0, 0, 0))
    other = found(map_of(turn), seen(QUERY, 9), turn, off=(0, 0, 0))
    wide = np.kron(np.eye(2), turn[:3, :3])
    expected = wide @ one.covariance @ wide.T
    np.testing.assert_allclose(other.covariance, expected, atol=0.02 * np.abs(expected).max())
    assert np.abs(other.covariance - one.covariance).max() > 0.1 * np.abs(expected).max()


def test_a_sensor_at_another_height_starts_there():
    high = sensor(2.0, -1.0, 1.2, z=4.8)
    points = seen(high, 9)
    place_map = map_of(np.eye(4))
    refined = found(place_map, points, np.eye(4), ground_z=-4.8)
    assert refined.pose[2, 3] == pytest.approx(4.8, abs=0.03)
    unaware = found(place_map, points, np.eye(4))  # 3 m too low, beyond what it can make up for
    assert unaware.doubt is not None or abs(unaware.pose[2, 3] - 4.8) < 0.05


def test_what_does_not_fit_is_a_doubt():
    place_map = map_of(np.eye(4))
    points = seen(QUERY, 9)
    location = place_map.localize(points)
    far = replace(location, place=0, x=500.0, y=0.0, trusted=True, doubt=None)
    refined = place_map.refine(points, far)
    assert (refined.converged, refined.doubt) == (False, "not converged")
    assert refined.pose[0, 3] == pytest.approx(500.0)
    assert np.sqrt(np.diag(refined.covariance))[:3].min() > 3.99
    assert len(refined.unobservable) == 6
    at = replace(location, place=0, x=QUERY[0, 3], y=QUERY[1, 3], yaw=1.2, trusted=False)
    assert place_map.refine(points, at).doubt == "location"
    short = RefinementSettings(max_shift=0.1)
    moved = replace(at, x=QUERY[0, 3] + 0.8)
    assert place_map.refine(points, moved, settings=short).doubt == "not converged"


def test_a_map_without_points_says_so():
    place_map = Map(NETWORK, -1.8)
    place_map.add([seen(PLACES[0])], PLACES[0][None], ["a"])
    location = place_map.localize(seen(QUERY))
    with pytest.raises(DataError, match="holds no points to register on"):
        place_map.refine(seen(QUERY), location)
    with pytest.raises(ConfigError, match="location"):
        place_map.refine(seen(QUERY), None)

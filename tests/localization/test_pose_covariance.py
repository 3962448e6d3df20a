"""Covariances of registered poses: what holds a pose and what does not, frames, noise, coverage."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.localization.registration.pose_covariance import (
    direction_name,
    in_sensor_frame,
    turned,
)
from deepring.localization.registration.refinement import RefinementSettings, refine

NOISE = 0.02


def rectangle(rng, corner, first, second, per_metre=6.0):
    """Points on a rectangle: a corner and two sides, metres."""
    corner, first, second = (np.asarray(v, dtype=float) for v in (corner, first, second))
    count = int(np.linalg.norm(first) * np.linalg.norm(second) * per_metre)
    return corner + rng.uniform(size=(count, 1)) * first + rng.uniform(size=(count, 1)) * second


def plane(rng):
    return rectangle(rng, (-30, -30, -1.8), (60, 0, 0), (0, 60, 0), 4.0)


def tunnel(rng):
    """Along x: two walls, floor and ceiling, the same as far as one sees."""
    sides = [((-40, -4, -1.8), (0, 8, 0)), ((-40, -4, 3), (0, 8, 0)),
             ((-40, -4, -1.8), (0, 0, 4.8)), ((-40, 4, -1.8), (0, 0, 4.8))]  # fmt: skip
    return np.concatenate([rectangle(rng, corner, (80, 0, 0), side) for corner, side in sides])


def wall(rng):
    """A road along x beside one long wall."""
    return np.concatenate([plane(rng), rectangle(rng, (-30, 6, -1.8), (60, 0, 0), (0, 0, 6))])


def crossing(rng):
    """The corner of two streets, which holds everything."""
    return np.concatenate([wall(rng), rectangle(rng, (12, -30, -1.8), (0, 36, 0), (0, 0, 6))])


def registered(scene, truth, seed=0, noise=NOISE, world=None, off=(0.2, -0.1)):
    """Two samples of a scene, the second as a sensor at ``truth`` sees it, registered."""
    rng = np.random.default_rng(seed)
    clean = scene(rng), scene(rng)
    reference, query = (points + rng.normal(0, noise, points.shape) for points in clean)
    if world is not None:
        reference, truth = reference @ world.T, pose_from(world, np.zeros(3)) @ truth
        query = query @ world.T
    query = (query - truth[:3, 3]) @ truth[:3, :3]
    yaw = math.atan2(truth[1, 0], truth[0, 0])
    return refine(query, reference, -yaw + 0.01, truth[:2, 3] + off), truth


TRUTH = pose_from(rotation_from_rpy(0.01, -0.02, 0.7), [1.5, -0.8, 0.1])


def names(found):
    return [direction_name(direction) for direction in found.unobservable]


def error(found, truth):
    turn = Rotation.from_matrix(truth[:3, :3] @ found.transform[:3, :3].T).as_rotvec()
    return np.concatenate([truth[:3, 3] - found.transform[:3, 3], turn])


def test_a_good_scene_holds_everything():
    found, truth = registered(crossing, TRUTH)
    assert found.converged
    assert names(found) == []
    deviations = np.sqrt(np.diag(found.covariance))
    assert deviations[:3].max() < 0.02
    assert deviations[3:].max() < math.radians(0.1)
    assert np.abs(error(found, truth)[:3]).max() < 0.02


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("scene", [tunnel, wall])
def test_nothing_holds_a_sensor_along_a_tunnel_or_a_wall(scene, seed):
    found, _ = registered(scene, TRUTH, seed)
    assert names(found) in (["along 0°"], ["along 180°"])
    assert abs(found.unobservable[0][0]) > 0.99
    deviations = np.sqrt(np.diag(found.covariance))
    assert deviations[0] > 0.5
    assert deviations[1:3].max() < 0.05  # across it and in height it is held


def test_nothing_but_height_and_tilt_is_held_on_a_plane():
    found, _ = registered(plane, TRUTH, off=(0, 0))
    assert len(found.unobservable) == 3
    assert names(found).count("yaw") == 1
    deviations = np.sqrt(np.diag(found.covariance))
    assert deviations[[0, 1]].min() > 1
    assert deviations[5] > math.radians(3)
    assert deviations[2] < 0.02
    assert deviations[[3, 4]].max() < math.radians(0.1)


def test_a_turned_world_turns_the_covariance():
    angle = math.radians(35)
    world = rotation_from_rpy(0, 0, angle)
    (one, _), (other, _) = registered(tunnel, TRUTH), registered(tunnel, TRUTH, world=world)
    assert names(other) == ["along 35°"]
    expected = turned(one.covariance, world)
    near, far = np.linalg.eigvalsh(expected), np.linalg.eigvalsh(other.covariance)
    np.testing.assert_allclose(np.log(near), np.log(far), atol=0.7)
    axis = world[:, 0]
    assert axis @ other.covariance[:3, :3] @ axis > 0.25
    # In the sensor's frame, both say the same; misread as the world's axes, they do not.
    assert in_sensor_frame(other.covariance, other.transform)[0, 0] == pytest.approx(
        in_sensor_frame(one.covariance, one.transform)[0, 0], rel=0.5
    )
    assert other.covariance[0, 0] < 0.9 * one.covariance[0, 0]


def test_less_noise_gives_a_smaller_covariance():
    rough, fine = (registered(crossing, TRUTH, noise=noise)[0] for noise in (0.12, 0.04))
    assert np.sqrt(np.diag(rough.covariance) / np.diag(fine.covariance)).min() > 1.5


def test_errors_are_as_large_as_the_covariance_says():
    distances = []
    for seed in range(20):
        found, truth = registered(crossing, TRUTH, seed)
        off = error(found, truth)
        distances.append(off @ np.linalg.solve(found.covariance, off))
    assert np.mean(np.array(distances) < chi2.ppf(0.95, 6)) >= 0.9
    assert np.median(distances) > 0.05  # nor is it so large that it says nothing


def test_what_does_not_converge_is_known_no_better_than_its_search():
    rng = np.random.default_rng(0)
    settings = RefinementSettings()
    found = refine(crossing(rng) + np.array([500, 0, 0]), crossing(rng), 0.0, (0, 0), settings)
    assert not found.converged
    deviations = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(deviations, [settings.max_shift] * 3 + [settings.max_turn] * 3)
    assert len(found.unobservable) == 6


def test_a_covariance_turns_with_its_frame():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    pose = pose_from(Rotation.random(random_state=0).as_matrix(), [3, 4, 5])
    errors = rng.normal(size=(200_000, 6)) @ root.T * 1e-3
    # T_true = T Exp(e): the shift along the sensor's axes, the rotation after it.
    shift = errors[:, :3] @ pose[:3, :3].T
    after = pose[:3, :3] @ Rotation.from_rotvec(errors[:, 3:]).as_matrix()
    turn = Rotation.from_matrix(after @ pose[:3, :3].T).as_rotvec()
    world = np.cov(np.hstack([shift, turn]).T)
    np.testing.assert_allclose(in_sensor_frame(world, pose), np.cov(errors.T), atol=3e-8)
    assert np.abs(world - np.cov(errors.T)).max() > 1e-6

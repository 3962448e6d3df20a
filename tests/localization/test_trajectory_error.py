"""Errors of trajectories, beside values that can be worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.errors import DataError
from deepring.localization.drives.trajectory_error import absolute_error, aligning, relative_error


def curve(n=200):
    t = np.linspace(0, 3, n)
    places = np.column_stack([60 * t, 20 * np.sin(2 * t), 3 * t**2])
    return pose_from(rotation_from_rpy(0.0, 0.05 * t, t), places)


def anywhere(seed):
    rng = np.random.default_rng(seed)
    return pose_from(Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_of_the_whole_is_no_error(seed):
    truth, world = curve(), anywhere(seed)
    np.testing.assert_allclose(aligning(world @ truth, truth), np.linalg.inv(world), atol=1e-9)
    assert absolute_error(world @ truth, truth).rmse < 1e-9
    relative = relative_error(world @ truth, truth, 10.0)
    assert relative.shift < 1e-9
    assert relative.turn < 1e-4
    # A motion in the sensor's frame is one of the sensor: it is an error.
    assert absolute_error(truth @ world, truth).rmse > 1


def test_a_mirrored_trajectory_is_an_error():
    truth = curve()
    mirrored = truth.copy()
    mirrored[:, 1, 3] *= -1
    mirrored[:, 2, 3] += 5 * np.sin(np.arange(200))  # so that it lies in no plane
    truth[:, 2, 3] += 5 * np.sin(np.arange(200))
    assert np.linalg.det(aligning(mirrored, truth)[:3, :3]) == pytest.approx(1)
    assert absolute_error(mirrored, truth).rmse > 3


def test_scale_is_an_error_too():
    truth = curve()
    larger = truth.copy()
    larger[:, :3, 3] *= 1.01
    # Least squares: the centred positions, times 0.01.
    centred = truth[:, :3, 3] - truth[:, :3, 3].mean(axis=0)
    expected = 0.01 * np.sqrt((centred**2).sum(axis=1).mean())
    assert absolute_error(larger, truth).rmse == pytest.approx(expected, rel=1e-3)
    # Over 10 m of path, 1 % of the way as the crow flies.
    relative = relative_error(larger, truth, 10.0)
    assert relative.shift == pytest.approx(0.1, rel=0.1)


def test_relative_errors_of_a_constant_turn():
    """A street of 1 m steps, whose estimate turns by 0.1° at each."""
    n, turn = 300, np.radians(0.1)
    truth = pose_from(np.tile(np.eye(3), (n, 1, 1)), np.eye(3)[0] * np.arange(n)[:, None])
    step = pose_from(rotation_from_rpy(0, 0, turn), [1.0, 0, 0])
    poses = [np.eye(4)]
    for _ in range(n - 1):
        poses.append(poses[-1] @ step)
    found = relative_error(np.stack(poses), truth, 100.0)
    assert found.stretches == n - 100
    assert found.turn == pytest.approx(10.0, rel=1e-6)
    arc = np.exp(1j * turn * np.arange(100)).sum()
    assert found.shift == pytest.approx(abs(arc - 100), rel=1e-6)
    assert relative_error(truth, truth, 299.5) is None


def test_different_numbers_are_refused():
    with pytest.raises(DataError, match="3 poses beside 4 true ones"):
        absolute_error(curve()[:3], curve()[:4])
    with pytest.raises(DataError, match="at least 3"):
        relative_error(curve()[:2], curve()[:2], 1.0)

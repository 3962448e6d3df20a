"""Rotations from their axes, poses as maps of points, headings and the turns of points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deepring.core.rigid import (
    NED_TO_UP,
    pose_from,
    rotation_from_rpy,
    turn_points,
    wrap_angle,
    yaw_after_turn,
    yaw_of,
)

angles = st.floats(-3, 3)
any_angle = st.floats(-50, 50)


def about(axis, angle):
    """Rodrigues' formula: the rotation by ``angle`` about a coordinate axis, right-handed."""
    cross = np.cross(np.eye(3), np.eye(3)[axis])  # its columns: axis x e_j
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


@given(angles, angles, angles)
def test_roll_is_applied_first_and_yaw_last(roll, pitch, yaw):
    rotation = rotation_from_rpy(roll, pitch, yaw)
    assert np.allclose(rotation, about(2, yaw) @ about(1, pitch) @ about(0, roll), atol=1e-12)


def test_yaw_first_and_roll_last_is_another_rotation():
    reversed_order = about(0, 0.4) @ about(1, 0.5) @ about(2, 0.6)
    assert np.abs(rotation_from_rpy(0.4, 0.5, 0.6) - reversed_order).max() > 0.1


@pytest.mark.parametrize("dtype", [np.float32, np.int64])
def test_rotations_broadcast_and_are_float64(dtype):
    rolls, yaws = np.array([[0], [1], [2]], dtype), np.array([0, 1, 2, 3], dtype)
    rotations = rotation_from_rpy(rolls, 1, yaws)
    assert (rotations.shape, rotations.dtype) == ((3, 4, 3, 3), np.float64)
    assert np.allclose(rotations @ rotations.swapaxes(-1, -2), np.eye(3), rtol=0, atol=1e-15)
    assert np.allclose(np.linalg.det(rotations), 1)
    assert np.array_equal(rotations[2, 3], rotation_from_rpy(2.0, 1.0, 3.0))


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
def test_a_pose_turns_points_and_then_moves_them(batch):
    rng = np.random.default_rng(0)
    rotation, translation = rng.random((*batch, 3, 3)), rng.random((*batch, 3))
    point = rng.random(3)
    pose = pose_from(rotation, translation)
    assert pose.shape == (*batch, 4, 4)
    moved = pose @ np.append(point, 1.0)
    assert np.allclose(moved[..., :3], rotation @ point + translation)
    assert np.array_equal(moved[..., 3], np.ones(batch))


def test_poses_are_float64_from_anything_array_like():
    pose = pose_from(np.eye(3, dtype=np.int64).tolist(), np.array([0.5, 1.5, 2.5], np.float32))
    assert pose.dtype == np.float64
    assert pose[:3, 3].tolist() == [0.5, 1.5, 2.5]
    assert pose_from(np.eye(3, dtype=np.float32), [1 / 3, 0, 0])[0, 3] == 1 / 3


@given(st.floats(-3, 3), st.floats(-1.5, 1.5), st.floats(-3.14, 3.14))
def test_the_yaw_is_that_of_roll_pitch_and_yaw(roll, pitch, yaw):
    rotation = rotation_from_rpy(roll, pitch, yaw)
    assert yaw_of(rotation) == pytest.approx(yaw, abs=1e-9)
    assert yaw_of(pose_from(rotation, [4.0, 5.0, 6.0])) == yaw_of(rotation)


def test_the_yaw_of_many_poses_is_that_of_each():
    yaws = np.linspace(-3, 3, 6).reshape(2, 3)
    rotations = rotation_from_rpy(0.1, -0.2, yaws)
    assert np.allclose(yaw_of(rotations), yaws)
    single = yaw_of(rotations.astype(np.float32))
    assert (single.shape, single.dtype) == ((2, 3), np.float64)
    assert yaw_of(about(2, 1.0).tolist()) == pytest.approx(1.0)


@given(any_angle)
def test_a_wrapped_angle_points_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


def test_half_a_turn_is_wrapped_to_its_negative():
    assert wrap_angle(math.pi) == wrap_angle(-math.pi) == -math.pi
    assert wrap_angle(3.0) == pytest.approx(3.0)


def seen(world, heading):
    """The points that a sensor at the origin sees, in its own frame."""
    return (pose_from(rotation_from_rpy(0, 0, heading), np.zeros(3))[:3, :3].T @ world.T).T


@given(any_angle, any_angle)
def test_a_turn_of_the_points_is_the_opposite_turn_of_the_sensor(yaw, turn):
    world = np.random.default_rng(1).normal(size=(5, 3))
    heading = yaw_after_turn(yaw, turn)
    assert -math.pi <= heading < math.pi
    assert np.allclose(seen(world, heading), turn_points(seen(world, yaw), turn), atol=1e-9)
    # The turn between two headings is had by the same function.
    turn_back = yaw_after_turn(yaw, heading)
    assert np.allclose(seen(world, heading), turn_points(seen(world, yaw), turn_back), atol=1e-9)


def test_a_sensor_that_turned_with_its_points_would_see_something_else():
    world = np.random.default_rng(1).normal(size=(5, 3))
    misread = turn_points(seen(world, 0.5), 0.25)
    assert np.abs(seen(world, 0.75) - misread).max() > 0.1


@given(any_angle)
def test_turned_points_are_rotated_about_z(turn):
    points = np.random.default_rng(2).normal(size=(7, 3))
    assert np.allclose(turn_points(points, turn), points @ about(2, turn).T, atol=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_turned_points_keep_their_dtype_and_height(dtype):
    points = np.random.default_rng(3).normal(size=(7, 3)).astype(dtype)
    turned = turn_points(points, 0.3)
    assert turned.dtype == dtype
    assert np.array_equal(turned[:, 2], points[:, 2])


def test_ned_to_up_keeps_the_sense_of_yaw():
    """Clockwise seen from above, as NED counts it, is the other way round with z up."""
    heading_north_east = about(2, 0.5)  # NED: from x, north, towards y, east
    assert yaw_of(NED_TO_UP @ heading_north_east @ NED_TO_UP) == pytest.approx(-0.5)
    z_alone = np.diag([1.0, 1.0, -1.0])  # the usual misreading, a left-handed frame
    assert yaw_of(z_alone @ heading_north_east @ z_alone) == pytest.approx(0.5)
    assert np.linalg.det(NED_TO_UP) == pytest.approx(1)
    assert np.linalg.det(z_alone) == pytest.approx(-1)

"""What is a pose: a rotation within the digits given; nothing scaled, sheared or mirrored."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from
from deepring.data.poses.pose_tables import poses_from_quaternions, poses_from_rows
from deepring.data.poses.rigid import rigid_rows, rotation_problem, rounding, unit_rows
from deepring.data.poses.trajectory import Trajectory
from deepring.data.readers.kitti import open_kitti
from deepring.errors import DataError
from helpers.real_data import real_data

RNG = np.random.default_rng(0)
ROTATIONS = Rotation.random(300, random_state=0).as_matrix()
#: As published with KITTI's sequence 00: 13 digits, which are a rotation to some 1e-6.
KITTI_TR = (
    "4.276802385584e-04 -9.999672484946e-01 -8.084491683471e-03 -1.198459927713e-02 "
    "-7.210626507497e-03 8.081198471645e-03 -9.999413164504e-01 -5.403984729748e-02 "
    "9.999738645903e-01 4.859485810390e-04 -7.206933692422e-03 -2.921968648686e-01"
)


def poses(rotations):
    return pose_from(rotations, RNG.normal(0, 1e6, (len(rotations), 3)))


@pytest.mark.parametrize("form", ["%.2f", "%.3f", "%.4f", "%.6f", "%.6e", "%g", "%.3g", "%.17g"])
def test_rotations_in_any_number_of_digits_are_rotations(form):
    written = np.array([[float(form % v) for v in r.ravel()] for r in ROTATIONS]).reshape(-1, 3, 3)
    assert rigid_rows(poses(written)).all()
    assert rigid_rows(poses(written[:1])).all()


@pytest.mark.parametrize("decimals", [2, 3, 4, 6, 17])
@pytest.mark.parametrize("axis", ["scale", "shear", "mirror"])
def test_what_is_no_rotation_beyond_its_digits_is_refused(decimals, axis):
    """By 1 % of scale, which a pose was once taken with, and by less in more digits."""
    size = max(0.002, 2.5 * 10.0**-decimals)
    change = {
        "scale": np.eye(3) * (1 + size),
        "shear": np.array([[1, 4 * size, 0], [0, 1, 0], [0, 0, 1]]),
        "mirror": np.diag([1.0, 1.0, -1.0]),
    }[axis]
    wrong = np.round(ROTATIONS @ change, decimals)
    assert not rigid_rows(poses(wrong)).any()


def test_the_digits_are_those_of_the_whole_file():
    """A row of few digits among rows of many has no rounding to excuse it."""
    sheared = np.array([[[1, 0.01, 0], [0, 1, 0], [0, 0, 1.0]]])
    assert rigid_rows(poses(sheared))[0]  # as a rotation of 0.3° in two decimals may read
    mask = rigid_rows(poses(np.concatenate([ROTATIONS[:5], sheared])))
    assert mask.tolist() == [True] * 5 + [False]
    assert rounding(np.array([[0.71, 0.5]])) == 0.005
    assert rounding(np.array([[0.707, 0.5]])) == 0.0005
    assert rounding(np.array([[0.70710678, 0.5]])) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e300, 2.0, 0.0])
def test_extreme_values_are_no_poses(value):
    wrong = poses(ROTATIONS[:3])
    wrong[0, 1, 1] = value
    assert rigid_rows(wrong).tolist() == [False, True, True]
    assert rotation_problem(wrong[0])


def test_real_calibration_and_poses_are_rotations():
    tr = poses_from_rows(np.array(KITTI_TR.split(), dtype=np.float64).reshape(1, 12))
    assert rigid_rows(tr).all()
    session = open_kitti(real_data("kitti00_south"))
    assert len(session) == 974
    assert session.skipped.bad_poses == 0


@settings(derandomize=True)
@given(st.integers(0, 299), st.sampled_from([2, 3, 4, 6, 9]))
def test_quaternions_in_few_digits_are_unit(index, decimals):
    quaternion = np.round(Rotation.from_matrix(ROTATIONS[index]).as_quat(), decimals)
    assert unit_rows(quaternion[None])[0]
    [pose] = poses_from_quaternions(np.array([[1, 2, 3, *quaternion]]))
    angle = Rotation.from_matrix(pose[:3, :3].T @ ROTATIONS[index]).magnitude()
    assert angle < 2.5 * 10.0**-decimals + 1e-7
    for factor in (1.01, 0.99, 2.0, 0.0):
        if decimals > 2:
            assert not unit_rows(np.round(quaternion[None] * factor, decimals))[0]


def test_reasons_are_named():
    assert "lengths 1.004, 1.004, 1.004" in rotation_problem(poses(1.004 * ROTATIONS[:1])[0])
    assert "mirrors" in rotation_problem(poses(ROTATIONS[:1] @ np.diag([1, -1, 1]))[0])
    sheared = ROTATIONS[0].copy()
    sheared[1] = (sheared[1] + 0.1 * sheared[0]) / np.hypot(1, 0.1)
    assert "right angles" in rotation_problem(poses(sheared[None])[0])


def test_a_few_bad_rows_are_left_out_and_many_are_an_error():
    rows = poses(ROTATIONS[:10])
    rows[2, :3, :3] *= 1.004
    rows[5, 0, 0] = np.nan
    trajectory = Trajectory(np.arange(10), rows)
    assert trajectory.bad_poses == 2
    assert trajectory.stamps.tolist() == [0, 1, 3, 4, 6, 7, 8, 9]
    rows[:6, :3, :3] *= 1.004
    with pytest.raises(DataError, match=r"truth\.csv: 6 of its 10 pose rows .*1\.004"):
        Trajectory(np.arange(10), rows, "truth.csv")

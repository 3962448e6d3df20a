"""Odometry of scans whose motion is known; where it is lost, it says so."""

import sys

import numpy as np
import pytest

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.scans.point_times import TimedPoints
from deepring.errors import BrokenScanError, ConfigError
from deepring.localization.drives.deskewing import deskewed, motion_over
from deepring.localization.drives.odometry import Odometry, OdometrySettings
from helpers.recorded_drives import laps, seen_from, town

SECOND = 10**9


def run(points, poses):
    odometry = Odometry()
    return [odometry.register(TimedPoints(seen_from(points, pose), None)) for pose in poses]


def test_poses_are_those_of_the_drive():
    poses = laps(40, rounds=0.4)
    steps = run(town(), poses)
    found = np.stack([step.pose for step in steps])
    expected = np.linalg.inv(poses[0]) @ poses  # the first scan's frame is the world
    assert np.abs(found - expected)[:, :3, 3].max() < 0.15
    assert np.abs(found - expected)[:, :3, :3].max() < 0.01
    assert not any(step.lost for step in steps)
    # The inverse, a usual misreading, is far off.
    assert np.abs(np.linalg.inv(found) - expected)[-1, :3, 3].max() > 5


def test_a_jump_is_lost_and_the_motion_goes_on_behind_it():
    poses = laps(40, rounds=0.4)
    jump = poses[20:].copy()
    jump[:, :3, 3] += [0.0, -32.0, 0.0]
    steps = run(town(), np.concatenate([poses[:20], jump]))
    assert [k for k, step in enumerate(steps) if step.lost] == [20]
    # Behind it the motion is right again, from where a constant velocity led.
    found = np.stack([step.pose for step in steps[20:]])
    moved = np.linalg.inv(found[0]) @ found[-1]
    expected = np.linalg.inv(jump[0]) @ jump[-1]
    assert np.linalg.norm(moved[:3, 3] - expected[:3, 3]) < 0.2
    step = np.linalg.norm(steps[19].pose[:3, 3] - steps[18].pose[:3, 3])
    assert np.linalg.norm(found[0][:3, 3] - steps[19].pose[:3, 3]) == pytest.approx(step, abs=0.1)


def test_stamps_tell_how_far_a_missing_scan_leads():
    """With 17° between scans a missing one leads astray, unless its time is counted."""
    points, poses = town(), laps(40, radius=12.0, rounds=0.97)[:16]
    kept = [k for k in range(16) if k not in (9, 10)]

    def lost(stamped):
        odometry = Odometry()
        scans = ((k, TimedPoints(seen_from(points, poses[k]), None)) for k in kept)
        steps = [
            odometry.register(scan, k * SECOND // 10 if stamped else None) for k, scan in scans
        ]
        return [kept[k] for k, step in enumerate(steps) if step.lost]

    assert lost(True) == []
    assert lost(False) == [11]


def test_results_do_not_vary():
    poses = laps(8, rounds=0.1)
    once, again = (run(town(), poses)[-1].pose for _ in range(2))
    np.testing.assert_array_equal(once, again)


def test_a_scan_of_few_points_is_refused_and_forgotten():
    points, poses = town(), laps(9, rounds=0.1)
    odometry = Odometry()
    first = [odometry.register(TimedPoints(seen_from(points, pose), None)) for pose in poses[:8]]
    sparse = TimedPoints(seen_from(points, poses[8])[:99], None)
    with pytest.raises(BrokenScanError, match="99 points between 1 and 100 m, expected at least"):
        odometry.register(sparse)
    last = odometry.register(TimedPoints(seen_from(points, poses[8]), None))
    assert not last.lost
    assert len(first) == 8


def test_deskewed_points_are_where_they_are_at_the_stamp():
    rng = np.random.default_rng(0)
    world = rng.uniform(-20, 20, (500, 3))
    times = rng.uniform(-0.05, 0.1, 500)
    turn, shift = 0.6, np.array([8.0, -1.0, 0.3])  # in a second

    def pose(t):  # of the sensor after t seconds, in its frame at the stamp
        return pose_from(rotation_from_rpy(0, 0, turn * t), shift * t)

    measured = np.stack(
        [(p - pose(t)[:3, 3]) @ pose(t)[:3, :3] for p, t in zip(world, times, strict=True)]
    )
    moved = deskewed(measured.astype(np.float32), times, pose(1.0))
    assert np.abs(moved - world).max() < 0.01
    assert np.abs(measured - world).max() > 0.5
    # Turned against the motion, twice as much is left.
    assert np.abs(deskewed(measured.astype(np.float32), -times, pose(1.0)) - world).max() > 0.5
    np.testing.assert_allclose(motion_over(pose(0.5), 2.0), pose(1.0), atol=1e-12)


def test_times_deskew_the_sweeps_of_a_moving_sensor():
    """Each sweep takes the 0.1 s to the next stamp, during which the sensor moves 1.2 m."""
    points = town()
    poses = laps(160, rounds=1.2)[:18]

    def sweep(k):
        start, end = poses[k], poses[k + 1]
        share = np.random.default_rng(k).uniform(0, 1, len(points))
        rotation = np.linalg.inv(start) @ end
        angle = np.arctan2(rotation[1, 0], rotation[0, 0]) * share
        local = (points - start[:3, 3]) @ start[:3, :3] - share[:, None] * rotation[:3, 3]
        c, s = np.cos(angle), np.sin(angle)
        x, y = c * local[:, 0] + s * local[:, 1], c * local[:, 1] - s * local[:, 0]
        near = np.hypot(x, y) < 40
        cloud = np.column_stack([x, y, local[:, 2]])[near].astype(np.float32)
        return cloud, share[near] * 0.1

    def off(timed):
        odometry = Odometry()
        for k in range(17):
            cloud, times = sweep(k)
            scan = TimedPoints(cloud, times if timed else None)
            step = odometry.register(scan, k * SECOND // 10)
            assert step.deskewed == timed
        moved = np.linalg.inv(step.pose) @ np.linalg.inv(poses[0]) @ poses[16]
        clean = (points - poses[16][:3, 3]) @ poses[16][:3, :3]
        far = np.hypot(clean[:, 0], clean[:, 1]) < 30
        return np.linalg.norm(moved[:3, 3]), step.points, clean[far]

    from scipy.spatial import KDTree

    (_, sharp, clean), (_, blurred, _) = off(True), off(False)
    away = [np.median(KDTree(cloud).query(clean)[0]) for cloud in (sharp, blurred)]
    assert away[0] < 0.6 * away[1]


def test_mistakes_are_named(monkeypatch):
    with pytest.raises(ConfigError, match=r"odometry\.max_range: 0"):
        OdometrySettings(max_range=0)
    with pytest.raises(ConfigError, match=r"odometry\.overlap: 2"):
        OdometrySettings(overlap=2)
    monkeypatch.setitem(sys.modules, "kiss_icp.kiss_icp", None)
    with pytest.raises(ConfigError, match=r"pip install 'deepring\[odometry\]'"):
        Odometry()

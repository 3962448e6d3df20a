"""Neighbouring scans fit by right poses, and contradict wrong ones, which are named."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.inspection.motion import inverse_poses
from deepring.data.inspection.overlays import check_overlays
from deepring.data.inspection.poses import overlay_findings
from deepring.data.inspection.registration import (
    Planar,
    fit_of,
    planar_between,
    register,
    standing_cells,
)
from deepring.data.inspection.scan_pairs import FARTHEST
from deepring.data.readers.kitti import open_kitti
from deepring.data.session import Session
from deepring.errors import BrokenScanError
from helpers.real_data import real_data

HEIGHT = 1.7
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


@cache
def town():
    """Points (n, 3) on the walls of blocks, world z up, ground at 0."""
    rng, walls = np.random.default_rng(0), []
    for x in range(-110, 131, 40):
        for y in range(-110, 131, 40):
            width, depth, height = rng.uniform(4, 12, 3)
            east, north = x + rng.uniform(-6, 6), y + rng.uniform(-6, 6)
            u, z = rng.uniform(-1, 1, 900), rng.uniform(0, height, 900)
            for side in (-1, 1):
                walls.append([east + side * width + 0 * u, north + depth * u, z])
                walls.append([east + width * u, north + side * depth + 0 * u, z])
    return np.concatenate(walls, axis=1).T


def drive_poses(step=3.0):
    """A street to the east, a left turn, a street to the north, and a right turn: 34 poses."""
    turn = np.linspace(0, np.pi / 2, 6)
    yaw = np.concatenate([np.zeros(10), turn, np.full(8, np.pi / 2), turn[::-1], np.zeros(4)])
    moves = step * np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=-1)
    rotations = rotation_from_rpy(0.01, -0.02, yaw)
    return pose_from(rotations, np.cumsum(moves, axis=0) + np.array([-50, -10, HEIGHT]))


def scan(pose, seed):
    """Points (n, 3) float32 of the walls within 70 m, half of them, and of the ground."""
    rng = np.random.default_rng(seed)
    walls = town()
    near = walls[np.hypot(*(walls[:, :2] - pose[:2, 3]).T) < 70]
    near = near[rng.random(len(near)) < 0.5]
    ground = np.column_stack([pose[:2, 3] + rng.uniform(-60, 60, (3000, 2)), np.zeros(3000)])
    points = np.concatenate([near, ground]) - pose[:3, 3]
    return (points @ pose[:3, :3] + rng.normal(0, 0.02, (len(points), 3))).astype(np.float32)


@cache
def scans():
    return [scan(pose, k) for k, pose in enumerate(drive_poses())]


def session_of(poses, points=None):
    points = scans() if points is None else points
    poses = np.ascontiguousarray(poses)
    files = tuple(Path(f"{k:04d}.bin") for k in range(len(poses)))
    return Session(
        "drive", files, poses, poses[:, :2, 3].copy(), None, lambda f: points[int(f.stem)]
    )


def turned(degrees):
    return pose_from(rotation_from_rpy(0, 0, np.radians(degrees)), np.zeros(3))


def test_right_poses_fit():
    result = check_overlays(session_of(drive_poses()))
    assert result.findings == []
    assert result.summary.startswith("8 of 8 pairs of neighbouring scans fit by their poses (1.00")
    # In UTM, turned, and as poses of one world or another: only relative motion counts.
    moved = pose_from(rotation_from_rpy(0, 0, 2.0), [345000, 4037000, 12]) @ drive_poses()
    assert check_overlays(session_of(moved)).findings == []


def rotations_inverted(poses):
    poses = poses.copy()
    poses[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return poses


def scaled(poses, factor):
    poses = poses.copy()
    poses[:, :3, 3] *= factor
    return poses


def without_rotations(poses):
    poses = poses.copy()
    poses[:, :3, :3] = np.eye(3)
    return poses


def swapped(poses):
    poses = poses.copy()
    poses[:, [0, 1], 3] = poses[:, [1, 0], 3]
    return poses


WRONG = {
    "inverse poses": inverse_poses,
    "inverse poses,": lambda poses: inverse_poses(np.linalg.inv(poses[0]) @ poses),
    "inverse rotations": rotations_inverted,
    "y and yaw of the other sign": lambda poses: MIRROR @ poses @ MIRROR,
    "scans turned by 90°": lambda poses: poses @ turned(90),
    "scans turned by -90°": lambda poses: poses @ turned(-90),
    "180°": lambda poses: poses @ turned(180),
    "scans turned by 30°": lambda poses: poses @ turned(30),
    "x and y swapped": swapped,
    "positions times 2": lambda poses: scaled(poses, 0.5),
    "positions times 0.6": lambda poses: scaled(poses, 1.6),
    "reverse order": lambda poses: poses[::-1],
    "other scans": lambda poses: np.concatenate([poses[4:], poses[-4:]]),
    "of one drive": without_rotations,
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_poses_are_found_and_named(name):
    [finding] = overlay_findings(session_of(WRONG[name](drive_poses())))
    assert "contradict" in finding.found
    assert name in finding.advice
    assert not finding.unusable  # from a few pairs: a doubt


@pytest.mark.parametrize("factor", [0.8, 0.88, 1.12, 1.25])
def test_poses_of_a_slightly_other_scale_are_found(factor):
    """As of a camera's or an odometer's scale: each pair alone fits well enough."""
    [finding] = overlay_findings(session_of(scaled(drive_poses(), factor)))
    named = float(re.search(r"times ([\d.]+)", finding.advice)[1])
    assert named == pytest.approx(1 / factor, abs=0.04)
    assert overlay_findings(session_of(scaled(drive_poses(), 1.03))) == []


def test_the_finding_says_how_well_scans_fit_with_and_without():
    [finding] = overlay_findings(session_of(drive_poses() @ turned(180)))
    assert "8 of 8 pairs" in finding.found
    assert "m forward" in finding.found
    assert "of what stands out fits by the poses" in finding.found


def test_scans_of_another_place_fit_nowhere():
    far = [scan(pose @ pose_from(np.eye(3), [0, 0, 0]), k) for k, pose in enumerate(drive_poses())]
    mixed = [far[(7 * k) % len(far)] for k in range(len(far))]
    [finding] = overlay_findings(session_of(scaled(drive_poses(), 0.1), mixed))
    assert "contradict" in finding.found or "do not resemble" in finding.found


def test_what_cannot_be_compared_is_said():
    poses = drive_poses()
    far = scaled(poses, 10)
    assert check_overlays(session_of(far)).summary == (
        "not compared: neighbouring scans are 30 m apart"
    )
    one = session_of(poses[:1])
    flat = [points * [1, 1, 0.01] for points in scans()]
    plain = session_of(poses, [points.astype(np.float32) for points in flat])
    tilted = session_of(poses @ pose_from(rotation_from_rpy(1.5, 0, 0), np.zeros(3)))
    for session, reason in [(one, "one scan"), (plain, "stands out"), (tilted, "tilted")]:
        result = check_overlays(session)
        assert result.findings == []
        assert result.summary.startswith("not compared")
        assert reason in result.summary


def test_two_scans_are_enough_and_keyframes_may_be_far_apart():
    poses = drive_poses()
    for stride in (1, 2, 4, 6):
        few = session_of(poses[::stride], scans()[::stride])
        assert check_overlays(few).findings == []
        assert "fit by their poses" in check_overlays(few).summary
        turned_scans = session_of(poses[::stride] @ turned(90), scans()[::stride])
        assert len(check_overlays(turned_scans).findings) == 1
    assert FARTHEST == 20
    pair = session_of(poses[2:4], scans()[2:4])
    assert check_overlays(pair).summary.startswith("1 of 1")
    assert len(overlay_findings(session_of(poses[2:4] @ turned(90), scans()[2:4]))) == 1


def test_standing_still_fits():
    still = [scan(drive_poses()[0], k) for k in range(30)]
    session = session_of(np.repeat(drive_poses()[:1], 30, axis=0), still)
    assert check_overlays(session).findings == []


def test_broken_scans_are_left_out():
    session = session_of(drive_poses())

    def read(file):
        if int(file.stem) < 20:
            raise BrokenScanError(f"{file}: 0 bytes")
        return session.read(file)

    assert "fit by their poses" in check_overlays(replace(session, read=read)).summary


@settings(deadline=None, max_examples=15, derandomize=True)
@given(
    st.floats(-9, 9), st.floats(-9, 9), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.booleans()
)
def test_registration_finds_the_pose_of_a_scan(x, y, yaw, expected, tilted):
    """Whatever is expected, and with the scan seen by a tilted sensor."""
    first = drive_poses()[12]
    tilt = rotation_from_rpy(0.1, -0.1, 0) if tilted else np.eye(3)
    second = first @ pose_from(rotation_from_rpy(0, 0, yaw) @ tilt, [x, y, 0])
    truth = planar_between(first, second)
    a, b = (standing_cells(scan(pose, k), pose) for k, pose in enumerate((first, second)))
    best = register(a, b, Planar(0.0, 0.0, expected))
    assert best.clear
    assert best.found.distance(truth) < 0.7
    assert best.found.turn(truth) < 3.1
    assert fit_of(a, b, truth) > 0.9


def test_real_scans_fit_and_show_wrong_poses():
    session = open_kitti(real_data("kitti00_south"))
    result = check_overlays(session)
    assert result.findings == []
    assert result.summary.startswith("8 of 8")
    for name in ("inverse poses", "inverse rotations", "y and yaw of the other sign"):
        [finding] = overlay_findings(replace(session, poses=WRONG[name](session.poses)))
        assert name in finding.advice
    assert len(overlay_findings(replace(session, poses=np.roll(session.poses, 20, axis=0)))) == 1


@pytest.mark.parametrize("start", [0, 190, 430, 700, 940])
def test_parts_of_a_real_drive_are_not_doubted(start):
    session = open_kitti(real_data("kitti00_south"))
    for count, stride in [(2, 1), (5, 1), (30, 1), (10, 3)]:
        chosen = slice(start, start + count * stride, stride)
        part = replace(
            session,
            files=session.files[chosen],
            poses=session.poses[chosen],
            ground_truth=session.ground_truth[chosen],
        )
        assert check_overlays(part).findings == []

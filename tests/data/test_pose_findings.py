"""Poses that cannot be those of their scans are found; those of drives are not doubted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.inspection.motion import FROM_CAMERA, inverse_poses
from deepring.data.inspection.overlays import check_overlays
from deepring.data.inspection.poses import pose_findings
from deepring.data.readers.kitti import open_kitti
from deepring.data.session import Session, SkippedScans
from helpers.real_data import real_data

SECOND = 1_000_000_000
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def path_of(yaw, step=1.0, start=(345000.0, 4037000.0, 30.0), slope=0.0):
    """Poses (n, 4, 4) of a car that drives forwards with headings ``yaw`` (n,)."""
    yaw = np.asarray(yaw, dtype=np.float64)
    moves = step * np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw + slope], axis=-1)
    positions = np.cumsum(moves, axis=0) - moves[0] + start
    wobble = 0.02 * np.sin(np.arange(len(yaw)))
    return pose_from(rotation_from_rpy(wobble, wobble - slope, yaw), positions)


#: A straight road, a town block, a winding road, a crossing, a circle.
PATHS = {
    "straight": path_of(np.full(60, 0.7)),
    "crossing": path_of(np.repeat([0.0, np.pi / 2], 30)),
    "block": path_of(np.repeat([0.3, 1.87, 3.44, 5.01], 40)),
    "winding": path_of(1.2 * np.sin(np.linspace(0, 9, 120)), step=2.5, slope=0.1),
    "circle": path_of(np.linspace(0, 4 * np.pi, 200)),
}
TURNING = ("crossing", "block", "circle")


def session_of(poses, stamps=None, **options):
    poses = np.ascontiguousarray(poses)
    files = tuple(Path(f"{k}.bin") for k in range(len(poses)))
    return Session("drive", files, poses, poses[:, :2, 3].copy(), stamps, lambda _: None, **options)


def found(poses, stamps=None, **options):
    return pose_findings(session_of(poses, stamps, **options))


def stamps_of(poses, rate=10):
    return 1_700_000_000 * SECOND + np.arange(len(poses)) * (SECOND // rate)


def turned(degrees):
    return pose_from(rotation_from_rpy(0, 0, np.radians(degrees)), np.zeros(3))


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("mount", [0.0, 90.0, 180.0])  # the LiDAR's x need not be the car's
def test_drives_are_not_doubted(name, mount):
    poses = PATHS[name] @ turned(mount)
    assert found(poses) == []
    assert found(poses, stamps_of(poses)) == []
    assert found(poses[::20], stamps_of(poses)[::20]) == []
    assert found(poses[:1]) == []
    assert found(poses[:2]) == []


def test_noise_reversing_and_a_handheld_lidar_are_not_doubted():
    rng = np.random.default_rng(0)
    noisy = PATHS["block"].copy()
    noisy[:, :3, 3] += rng.normal(0, 0.2, (len(noisy), 3))
    assert found(noisy) == []
    parking = np.concatenate([PATHS["block"], PATHS["block"][:-20:-1]])
    assert found(parking) == []
    tilts = rng.normal(0, 0.15, (2, len(noisy)))
    handheld = noisy @ pose_from(rotation_from_rpy(*tilts, 0), np.zeros(3))
    assert found(handheld) == []
    # A parking garage: three turns up a ramp.
    assert found(path_of(np.linspace(0, 6 * np.pi, 300), slope=0.15)) == []


def test_a_platform_that_drives_sideways_is_doubted_only_without_any_heading():
    wheels = PATHS["block"] @ turned(0)
    heading = rotation_from_rpy(0, 0, np.linspace(0, 0.8, len(wheels)))
    wheels[:, :3, :3] = wheels[:, :3, :3] @ heading
    assert found(wheels) == []
    wheels[:, :3, :3] = np.eye(3)
    [finding] = found(wheels)
    assert "constancy" in finding.found
    assert "sideways" in finding.advice
    assert not finding.unusable


def camera(poses):
    return FROM_CAMERA.T @ np.linalg.inv(poses[0]) @ poses @ FROM_CAMERA


@pytest.mark.parametrize("name", PATHS)
def test_poses_of_a_camera_are_found_and_named(name):
    [finding] = found(camera(PATHS[name]))
    assert finding.unusable
    assert "camera" in finding.advice
    assert "in the plane" in finding.found or "tilted" in finding.found


@pytest.mark.parametrize("name", TURNING)
def test_opposite_turns_are_found_and_named(name):
    poses = PATHS[name].copy()
    poses[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    [finding] = found(poses)
    assert "inverse rotations" in finding.advice


@pytest.mark.parametrize("name", ["block", "winding"])  # on a circle they drive backwards
def test_inverse_poses_are_found_and_named(name):
    poses = inverse_poses(np.linalg.inv(PATHS[name][0]) @ PATHS[name])
    assert "inverses" in found(poses)[0].advice
    # With UTM coordinates, inverse positions are far apart.
    assert any("inverses" in f.advice for f in found(inverse_poses(PATHS[name])))


@pytest.mark.parametrize("name", TURNING)
def test_quaternions_with_w_first_are_found_and_named(name):
    poses = PATHS[name].copy()
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    poses[:, :3, :3] = Rotation.from_quat(np.roll(quaternions, 1, axis=1)).as_matrix()
    [finding] = found(poses)
    assert "w first" in finding.advice


@pytest.mark.parametrize("name", PATHS)
def test_a_world_or_scans_upside_down_are_found_and_named(name):
    [world] = found(DOWN @ PATHS[name])
    [scans] = found(PATHS[name] @ DOWN)
    assert world.unusable
    assert scans.unusable
    assert "z down" in world.advice
    assert "z down" in scans.advice


def test_degrees_for_radians_are_found():
    poses = path_of(np.repeat([0.3, 1.87, 3.44, 5.01], 40), slope=0.05)
    angles = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX", degrees=True)
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    assert found(poses)


@pytest.mark.parametrize(("scale", "word"), [(1000, "steps"), (100, "apart"), (0.001, "within")])
def test_other_units_are_found(scale, word):
    poses = path_of(np.repeat([0.3, 1.87, 3.44, 5.01], 30), step=2.0)
    poses[:, :3, 3] *= scale
    assert any(word in f.found for f in found(poses))


def test_poses_whose_steps_no_drive_has_are_unusable():
    poses = path_of(np.repeat([0.3, 1.87, 3.44, 5.01], 30), step=0.8)
    stamps = stamps_of(poses, rate=10)
    millimetres = poses.copy()
    millimetres[:, :3, 3] *= 1000
    [finding] = found(millimetres, stamps)
    assert finding.unusable
    assert "if they are millimetres, neighbouring ones are 0.8 m apart" in finding.advice
    assert not any(f.unusable for f in found(millimetres))  # 800 m each, and no stamps to say more
    millimetres[:, :3, 3] *= 2
    assert [f.unusable for f in found(millimetres)] == [True]
    jumps = poses.copy()
    jumps[50:60, 0, 3] += 5e4  # a few rows alone are a doubt
    assert not any(f.unusable for f in found(jumps, stamps))


def test_poses_that_stand_still_or_are_held_are_found():
    poses = PATHS["block"]
    [still] = found(np.repeat(poses[:1], 30, axis=0))
    assert "within 0 m" in still.found
    [held] = found(poses[np.arange(len(poses)) // 4 * 4])
    assert "same as the pose before" in held.found


def test_jumps_are_found_by_their_speed():
    poses = PATHS["block"].copy()
    stamps = stamps_of(poses)
    poses[50:60, 0, 3] += 30
    [finding] = found(poses, stamps)
    assert "2 of 159 steps are faster than 70 m/s" in finding.found
    assert found(poses) == []  # keyframes without stamps may leave out a street
    poses[50:60, 0, 3] -= 4e6  # rows of zeros before a fix
    assert any("exceed 1000 m" in f.found for f in found(poses))


def test_equal_and_falling_stamps_are_found():
    poses = PATHS["block"]
    stamps = stamps_of(poses, rate=1)
    stamps[20] = stamps[19]
    [finding] = found(poses, stamps)
    assert finding.subject == "stamps"
    assert "1 of 160" in finding.found
    late = stamps_of(poses, rate=1) + np.arange(len(poses)) * 30_000 * SECOND
    assert any("days" in f.found for f in found(poses, late))
    assert any("earlier" in f.found for f in found(poses, stamps_of(poses, 1)[::-1]))


def test_stamps_are_held_against_the_names_of_scans():
    poses = PATHS["block"]
    stamps = stamps_of(poses) + 123_456_789
    for names in (
        [f"{s}.bin" for s in stamps],
        [f"{s // 1000}.pcd" for s in stamps],
        [f"{s // SECOND}.{s % SECOND:09d}.pcd" for s in stamps],
    ):
        session = session_of(poses, stamps)
        session = replace(session, files=tuple(map(Path, names)))
        assert pose_findings(session) == []
        [finding] = pose_findings(replace(session, stamps=stamps - 3 * SECOND))
        assert finding.subject == "stamps"
        assert "3 s from those in the names" in finding.found


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, -1e18, 1.1])
def test_matrices_that_are_no_poses_are_found(value):
    poses = PATHS["block"].copy()
    poses[7, 0, 0 if value == 1.1 else 3] = value
    [finding] = found(poses, stamps_of(poses))
    assert finding.unusable
    assert "1 of 160 are not rigid (7.bin: " in finding.found
    assert check_overlays(session_of(poses)).summary == "not compared: poses are not rigid"


@settings(derandomize=True, deadline=None, max_examples=60)
@given(
    st.integers(1, 12),
    st.floats(0, 11),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=12, max_size=12),
    st.integers(0, 99),
)
def test_any_poses_and_stamps_have_findings_and_no_error(n, power, stamps, seed):
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(n, random_state=seed).as_matrix()
    poses = pose_from(rotations, rng.normal(0, 10**power, (n, 3)))
    for finding in found(poses, np.array(stamps[:n], dtype=np.int64)):
        assert finding.found
        assert finding.advice
        assert "\n" not in str(finding)


def test_scans_without_poses_are_found():
    poses = PATHS["block"]
    [finding] = found(poses, skipped=SkippedScans(without_pose=40))
    assert "40 of 200 scans have none" in finding.found
    assert found(poses, skipped=SkippedScans(without_pose=2)) == []


def test_a_real_drive_is_not_doubted():
    session = open_kitti(real_data("kitti00_south"))
    assert pose_findings(session) == []
    wrong = replace(session, poses=camera(session.poses))
    assert "camera" in pose_findings(wrong)[0].advice

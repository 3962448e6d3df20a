"""A pose graph closes true loops, is not bent by wrong ones, and mends breaks."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.errors import ConfigError
from deepring.localization.drives import pose_graph
from deepring.localization.drives.drive_result import DriveResult, Truth
from deepring.localization.drives.loop_graph import Loop, LoopGraph, Track
from deepring.localization.drives.pose_graph import PoseGraphSettings, corrected, optimize
from deepring.localization.drives.trajectory_error import absolute_error

N = 240


def drive(rounds=2.0, radius=80.0):
    """True poses of two laps, on a hill."""
    angle = np.linspace(0, 2 * np.pi * rounds, N)
    height = 3 * np.sin(angle)
    places = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    return pose_from(rotation_from_rpy(0.0, 0.0, angle + np.pi / 2), places)


def drifted(truth, seed=0, bias=0.006, noise=0.02):
    """Odometry: the true motion, with noise, and a bias of 0.6 % and 0.006° a metre."""
    rng = np.random.default_rng(seed)
    poses = [truth[0]]
    for k in range(len(truth) - 1):
        step = np.linalg.inv(truth[k]) @ truth[k + 1]
        length = np.linalg.norm(step[:3, 3])
        turn = rng.normal(0, np.radians(0.05), 3) + length * np.array([0, 0.05e-3, 0.1e-3])
        off = pose_from(Rotation.from_rotvec(turn).as_matrix(), rng.normal(0, noise, 3))
        off[0, 3] += bias * length
        poses.append(poses[-1] @ step @ off)
    return np.stack(poses)


def loop(truth, earlier, keyframe, seed=0):
    """A refined loop, off by some centimetres and tenths of a degree."""
    rng = np.random.default_rng(seed)
    off = pose_from(
        Rotation.from_rotvec(rng.normal(0, np.radians(0.2), 3)).as_matrix(), rng.normal(0, 0.05, 3)
    )
    transform = np.linalg.inv(truth[earlier]) @ truth[keyframe] @ off
    return Loop(keyframe, earlier, transform, 0.5, 2.0, 0.9, refined=True)


def graph_of(truth, loops, **drift):
    return LoopGraph(np.arange(N), drifted(truth, **drift), None, loops)


def true_loops(truth):
    return [loop(truth, k - N // 2, k, seed=k) for k in range(N // 2, N, 6)]


def wrong_loops(truth, count=12):
    """Loops to other streets: eight anywhere, and four in a row with one offset."""
    rng = np.random.default_rng(1)
    found = []
    for k in range(count - 4):
        transform = pose_from(
            rotation_from_rpy(0, 0, rng.uniform(-3, 3)), [*rng.uniform(-8, 8, 2), 0.0]
        )
        found.append(Loop(130 + 9 * k, 5 + 7 * k, transform, 0.4, 1.5, 0.6, refined=True))
    for k in range(4):
        transform = pose_from(np.eye(3), [1.0, 0.5, 0.0])
        found.append(Loop(200 + k, 30 + k, transform, 0.4, 1.5, 0.6, refined=True))
    return found


def ate(poses, truth):
    return absolute_error(poses, truth).rmse


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_loops_bring_a_drifted_drive_back(seed):
    truth = drive()
    graph = graph_of(truth, true_loops(truth), seed=seed)
    result = optimize(graph)
    assert result.accepted.all()
    assert ate(graph.poses, truth) > 1.5
    # What is left is the scale, of which loops know nothing: 0.6 % of 80 m are 0.48 m.
    assert ate(result.poses, truth) < ate(graph.poses, truth) / 3
    assert ate(result.poses, truth) < 0.6
    np.testing.assert_allclose(result.poses[0], graph.poses[0], atol=1e-3)


def test_wrong_loops_do_not_bend_it():
    truth = drive()
    good, bad = true_loops(truth), wrong_loops(truth)
    clean = optimize(graph_of(truth, good))
    mixed = optimize(graph_of(truth, [*good, *bad]))
    assert mixed.accepted[: len(good)].all()
    assert not mixed.accepted[len(good) :].any()
    assert ate(mixed.poses, truth) < 1.05 * ate(clean.poses, truth)
    # Trusted blindly, they would.
    library = pose_graph.gtsam()
    factors, start = pose_graph._factors(library, graph_of(truth, [*good, *bad]))
    every = np.ones(len(good) + len(bad), dtype=bool)
    blind = pose_graph._solved(library, factors, every, (start,))
    poses = np.stack([blind.atPose3(k).matrix() for k in range(N)])
    assert ate(poses, truth) > 3 * ate(mixed.poses, truth)


def test_wrong_loops_alone_leave_the_odometry():
    truth = drive()
    graph = graph_of(truth, wrong_loops(truth))
    result = optimize(graph)
    assert not result.accepted.any()
    np.testing.assert_allclose(result.poses, graph.poses, atol=1e-3)


def test_no_loops_change_nothing():
    graph = graph_of(drive(), [])
    result = optimize(graph)
    np.testing.assert_array_equal(result.poses, graph.poses)
    assert len(result.accepted) == 0


def test_loops_mend_a_break():
    truth = drive()
    odometry = drifted(truth)
    jump = pose_from(rotation_from_rpy(0, 0, 0.7), [30.0, -20.0, 0.0])
    odometry[100:] = jump @ odometry[100:]
    graph = LoopGraph(np.arange(N), odometry, None, true_loops(truth), breaks=(100,))
    mended = optimize(graph)
    assert mended.accepted.all()
    assert ate(odometry, truth) > 10
    assert ate(mended.poses, truth) < 1.0
    # As odometry like any other, the loops across it would be taken for the mistake.
    believed = optimize(replace(graph, breaks=()))
    assert ate(believed.poses, truth) > 3


def test_scans_between_keyframes_move_with_them():
    truth = drive()
    poses = drifted(truth)
    rows = np.arange(3, N - 4, 5)
    track = Track("a", np.arange(N), [str(k) for k in range(N)], poses, None)
    graph = LoopGraph(rows, poses[rows], None, [])
    np.testing.assert_allclose(corrected(track, graph, poses[rows]), poses, atol=1e-9)
    moved = corrected(track, graph, truth[rows])
    np.testing.assert_allclose(moved[rows], truth[rows], atol=1e-9)
    assert ate(moved, truth) < 0.1
    shift = pose_from(rotation_from_rpy(0.1, 0.2, 0.3), [4, 5, 6])
    np.testing.assert_allclose(corrected(track, graph, shift @ poses[rows]), shift @ poses)
    # Errors are those of all scans.
    result = DriveResult(track, graph, 0.0, None, Truth.whole(truth))
    assert result.errors()["odometry"].absolute.rmse == pytest.approx(ate(poses, truth))


def test_the_library_is_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(ConfigError, match=r"pip install 'deepring\[optimize\]'"):
        optimize(graph_of(drive(), []))
    with pytest.raises(ConfigError, match=r"optimize\.confidence: 1"):
        PoseGraphSettings(1.0)

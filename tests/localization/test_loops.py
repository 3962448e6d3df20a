"""Loops of a drive that comes back: found among the past alone, and written as others read."""

import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deepring.cli.main import parse
from deepring.core.rigid import pose_from, rotation_from_rpy, yaw_of
from deepring.data.readers.nclt import open_nclt
from deepring.data.session import Session
from deepring.errors import DeepringError
from deepring.localization.candidates import RerankSettings
from deepring.localization.drives.drive_result import DriveResult, result_json
from deepring.localization.drives.graph_files import g2o_lines, loop_lines
from deepring.localization.drives.graph_noise import loop_covariance
from deepring.localization.drives.loop_graph import Loop, LoopGraph, Track
from deepring.localization.drives.loops import (
    LOOP_THRESHOLDS,
    LoopSettings,
    find_loops,
)
from deepring.localization.drives.trajectory_files import kitti_lines, tum_lines
from deepring.localization.location import AcceptanceThresholds
from deepring.localization.map import Map
from deepring.localization.registration.pose_covariance import in_sensor_frame
from deepring.localization.registration.refinement import RefinementSettings
from helpers.networks import small_network

SETTINGS = LoopSettings(spacing=10.0, recent=40.0)


def empty_map():
    return Map(small_network(), rerank=RerankSettings(candidates=30))


@pytest.fixture(scope="module")
def there_and_back(tiny_nclt):
    """Both drives over the same streets as one: the second comes back to the first."""
    drives = [open_nclt(tiny_nclt, date) for date in ("2031-02-04", "2031-03-17")]
    files = tuple(file for drive in drives for file in drive.files)
    join = lambda name: np.concatenate([getattr(drive, name) for drive in drives])  # noqa: E731
    return Session(
        "both", files, join("poses"), join("ground_truth"), join("stamps"), drives[0].read
    )


@pytest.fixture(scope="module")
def graph(there_and_back):
    return find_loops(there_and_back, empty_map(), SETTINGS)


def test_loops_are_true_and_go_back_far_enough(graph, there_and_back):
    assert len(graph.loops) >= 5
    steps = np.linalg.norm(np.diff(there_and_back.positions, axis=0), axis=1)
    driven = np.concatenate([[0], np.cumsum(steps)])[graph.scans]
    good = 0
    for loop in graph.loops:
        assert driven[loop.keyframe] - driven[loop.earlier] >= 40.0
        truth = np.linalg.inv(graph.poses[loop.earlier]) @ graph.poses[loop.keyframe]
        off = (loop.yaw - float(yaw_of(truth)) + math.pi) % (2 * math.pi) - math.pi
        good += np.hypot(loop.x - truth[0, 3], loop.y - truth[1, 3]) < 2 and abs(off) < 0.1
    assert good >= 0.9 * len(graph.loops)


def errors_of(graph):
    """Metres and radians (n, 2) that loops are off."""
    rows = []
    for loop in graph.loops:
        truth = np.linalg.inv(graph.poses[loop.earlier]) @ graph.poses[loop.keyframe]
        off = (loop.yaw - float(yaw_of(truth)) + math.pi) % (2 * math.pi) - math.pi
        rows.append((np.hypot(loop.x - truth[0, 3], loop.y - truth[1, 3]), abs(off)))
    return np.array(rows)


def test_the_command_asks_more_of_loops_than_of_locations():
    asked = parse(["loops", "folder", "-o", "out"])
    assert AcceptanceThresholds(asked.fit, asked.ratio) == LOOP_THRESHOLDS
    assert LoopSettings(asked.spacing, asked.recent) == LoopSettings()
    assert LOOP_THRESHOLDS.fit > AcceptanceThresholds().fit


def test_refined_loops_are_nearer_to_the_truth(graph, there_and_back):
    settings = replace(SETTINGS, refinement=RefinementSettings())
    refined = find_loops(there_and_back, empty_map(), settings)
    pairs = [[(loop.keyframe, loop.earlier) for loop in g.loops] for g in (graph, refined)]
    assert pairs[0] == pairs[1]
    done = np.array([loop.refined for loop in refined.loops])
    assert done.mean() >= 0.8
    before, after = np.median(errors_of(graph)[done], 0), np.median(errors_of(refined)[done], 0)
    assert (after < 0.5 * before).all()
    assert all(
        loop.inliers is not None and -math.pi <= loop.yaw <= math.pi for loop in refined.loops
    )
    unmoved = np.flatnonzero(~done)
    assert all(refined.loops[k].x == pytest.approx(graph.loops[k].x) for k in unmoved)
    assert not any(loop.refined or loop.inliers for loop in graph.loops)


def test_refinement_asks_for_its_library_at_once(there_and_back, monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    settings = replace(SETTINGS, refinement=RefinementSettings())
    with pytest.raises(DeepringError, match=r"pip install 'deepring\[refine\]'"):
        find_loops(there_and_back, empty_map(), settings)


def test_the_future_takes_no_part(there_and_back, graph):
    n = 2 * len(there_and_back.files) // 3
    first = Session(
        "part",
        there_and_back.files[:n],
        there_and_back.poses[:n],
        there_and_back.ground_truth[:n],
        None,
        there_and_back.read,
    )
    found = find_loops(first, empty_map(), SETTINGS)
    pairs = [(loop.keyframe, loop.earlier) for loop in found.loops]
    assert pairs == [
        (loop.keyframe, loop.earlier) for loop in graph.loops if loop.keyframe < len(found.scans)
    ]


@pytest.fixture
def square():
    """Four keyframes around a square, and a loop from the last to the first."""
    yaws = np.arange(4) * math.pi / 2
    places = np.array([[0, 0, 1], [10, 0, 1], [10, 10, 1], [0, 10, 1]], float)
    poses = pose_from(rotation_from_rpy(0.02, -0.03, yaws), places)
    transform = pose_from(rotation_from_rpy(0.01, 0.02, -math.pi / 2), [0.5, 10.0, 0.1])
    factor = np.random.default_rng(0).normal(size=(6, 6))
    covariance = 1e-3 * (factor @ factor.T + np.eye(6))
    loop = Loop(3, 0, transform, 0.4, math.inf, covariance=covariance)
    stamps = 1_567_496_784_952_532_897 + np.arange(4) * 1_500_000_001
    return LoopGraph(np.array([0, 5, 9, 12]), poses, stamps, [loop])


def test_g2o_is_what_gtsam_reads(square, tmp_path):
    gtsam = pytest.importorskip("gtsam")
    (tmp_path / "a.g2o").write_text("\n".join(g2o_lines(square)))
    factors, values = gtsam.readG2o(str(tmp_path / "a.g2o"), True)
    for k, pose in enumerate(square.poses):
        np.testing.assert_allclose(values.atPose3(k).matrix(), pose, atol=1e-8)
    edges = [factors.at(k) for k in range(factors.size())]
    for k, edge in enumerate(edges[:3]):
        assert list(edge.keys()) == [k, k + 1]
        expected = np.linalg.inv(square.poses[k]) @ square.poses[k + 1]
        np.testing.assert_allclose(edge.measured().matrix(), expected, atol=1e-8)
    [loop] = square.loops
    assert list(edges[3].keys()) == [0, 3]  # the keyframe in the earlier one's frame
    np.testing.assert_allclose(edges[3].measured().matrix(), loop.transform, atol=1e-8)
    # Rotation comes first there, and translation first in the file.
    order = [3, 4, 5, 0, 1, 2]
    information = np.linalg.inv(loop_covariance(loop))
    read = edges[3].noiseModel().information()
    np.testing.assert_allclose(read, information[np.ix_(order, order)], rtol=1e-6)
    assert not np.allclose(read, information, rtol=0.1)


def test_a_loop_is_loose_where_its_registration_is():
    """Along x of the earlier scan nothing holds; the keyframe looks along its y."""
    transform = pose_from(rotation_from_rpy(0, 0, math.pi / 2), [3, 4, 0])
    found = in_sensor_frame(np.diag([9.0, 0, 0, 0, 0, 0.04]), transform)
    np.testing.assert_allclose(np.diag(found), [0, 9, 0, 0, 0, 0.04], atol=1e-12)
    covariance = loop_covariance(Loop(3, 0, transform, 0.4, 2.0, 0.9, True, found))
    assert covariance[1, 1] == pytest.approx(9.01)
    assert covariance[0, 0] == pytest.approx(0.01)


def test_loops_are_rows_of_numbers(square, tmp_path):
    (tmp_path / "a.txt").write_text("\n".join(loop_lines(square.loops)))
    row = np.loadtxt(tmp_path / "a.txt")
    assert row[:2].tolist() == [0, 3]
    np.testing.assert_allclose(row[2:].reshape(4, 4), square.loops[0].transform, atol=1e-9)


def test_trajectories_have_exact_stamps_and_quaternions(square):
    lines = list(tum_lines(square.poses, square.stamps))
    assert [line.split()[0] for line in lines][:2] == [
        "1567496784.952532897",
        "1567496786.452532898",
    ]
    rows = np.array([line.split() for line in lines], float)
    assert np.allclose(rows[:, 1:4], square.poses[:, :3, 3])
    assert np.allclose(Rotation.from_quat(rows[:, 4:]).as_matrix(), square.poses[:, :3, :3])
    unstamped = tum_lines(square.poses, None)
    assert [line.split()[0] for line in unstamped][1] == "1.000000000"
    rows = np.array([line.split() for line in kitti_lines(square.poses)], float)
    assert np.allclose(rows.reshape(-1, 3, 4), square.poses[:, :3])


def test_json_names_scans_and_knows_no_infinity(square):
    names = [f"{k}.bin" for k in range(13)]
    track = Track("a", np.arange(100, 113), names, np.tile(np.eye(4), (13, 1, 1)), None)
    read = json.loads(result_json(DriveResult(track, square, -1.5)))
    assert read["scans"] == [100, 105, 109, 112]
    assert read["rows"] == [0, 5, 9, 12]
    assert read["names"][1] == "5.bin"
    assert read["stamps"] == square.stamps.tolist()
    assert read["stamps"][0] == 1_567_496_784_952_532_897
    assert read["loops"][0]["keyframe"] == 3
    assert read["loops"][0]["ratio"] is None
    np.testing.assert_allclose(read["loops"][0]["transform"], square.loops[0].transform)
    assert read["errors"] == {}


def test_mistakes_are_named(there_and_back):
    with pytest.raises(DeepringError, match=r"loops\.recent: 0"):
        LoopSettings(recent=0)
    filled = Map(small_network())
    filled.add([there_and_back.points(0)], there_and_back.poses[:1], ["a"])
    with pytest.raises(DeepringError, match="holds 1 places, expected none"):
        find_loops(there_and_back, filled, LoopSettings())

"""The comparison with peers: its definitions, and that it runs where no peer is installed."""

import csv
import importlib
import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from deepring.core.rigid import pose_from, rotation_from_rpy, turn_points
from deepring.data.session import Session

MODULES = ("peers", "peer_pairs", "peer_loops", "peer_table", "poses", "loops", "timing")


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    yield importlib.import_module
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture
def no_peers(monkeypatch):
    find = importlib.util.find_spec
    peers = ("map_closures", "kiss_matcher", "small_gicp")

    def found(name, package=None):
        return None if name in peers else find(name, package)

    monkeypatch.setattr(importlib.util, "find_spec", found)


@pytest.mark.usefixtures("no_peers")
def test_without_peers_deepring_stands_alone_and_they_are_named(
    benchmark, monkeypatch, tmp_path, tiny_nclt, capsys
):
    peers = benchmark("peers")
    monkeypatch.setattr(peers, "one_core", lambda: None)  # of the process of all tests
    peers.main([f"sim_nclt={tiny_nclt}", "--pairs", "2", "-o", str(tmp_path)])
    said = (tmp_path / "peers.md").read_text(encoding="utf-8")
    assert "absent: map-closures, kiss-matcher, small_gicp; run make peers" in said
    assert "| sim_nclt | deepring |" in capsys.readouterr().out
    with (tmp_path / "pairs.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["method"] for row in rows} == {
        "deepring, turns all around",
        "deepring, the descriptors' turn",
    }
    near = [row for row in rows if row["metres"] == "0 to 5"]
    assert [float(row["success"]) for row in near] == [1.0, 1.0]
    assert all(float(row["ms"]) > 0 and row["success_of"] == "2" for row in near)


def test_an_argument_without_a_folder_is_refused(benchmark, capsys):
    with pytest.raises(SystemExit, match="2"):
        benchmark("peers").main(["kitti"])
    assert "kitti: expected DATA=FOLDER" in capsys.readouterr().err


def test_wilson_s_interval(benchmark):
    share = benchmark("peer_table").Share
    assert share(8, 10).interval == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert share(10, 10).interval == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert share(0, 0).interval == (0.0, 1.0)
    assert str(share(0, 0)) == "none"
    assert str(share(8, 10)) == "0.800 (0.49 to 0.94)"


def test_points_turned_are_seen_from_the_turned_pose(benchmark):
    turned_pose = benchmark("peer_pairs").turned_pose
    pose = pose_from(rotation_from_rpy(0, 0, 0.3), [5.0, -2.0, 1.0])
    points = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
    world = lambda pose, seen: seen @ pose[:3, :3].T + pose[:3, 3]  # noqa: E731
    turned = turn_points(points, 0.8)
    assert world(turned_pose(pose, 0.8), turned) == pytest.approx(world(pose, points), abs=1e-5)
    misread = world(turned_pose(pose, -0.8), turned)
    assert np.abs(misread - world(pose, points)).max() > 0.5


def test_errors_lie_in_the_plane_and_around_the_circle(benchmark):
    errors = benchmark("peer_pairs").errors
    one = pose_from(rotation_from_rpy(0, 0, math.pi - 0.01), [1.0, 2.0, 0.0])
    other = pose_from(rotation_from_rpy(0, 0, 0.01 - math.pi), [4.0, 6.0, 9.0])
    assert errors(one, other) == pytest.approx((5.0, math.degrees(0.02)))


def test_a_keyframe_revisits_the_past_alone(benchmark):
    revisits = benchmark("peer_loops").revisits
    there = np.arange(0.0, 100.0, 10.0)
    positions = np.column_stack([np.concatenate([there, there[::-1]]), np.zeros(20)])
    path = np.arange(20) * 10.0
    found = revisits(positions, path, 50.0)
    # One comes back to within 10 m of what was driven 50 m of path before: from the 13th on.
    assert list(found) == list(range(12, 20))
    assert found[12].tolist() == [6]
    assert not revisits(positions, path, 500.0)


def drive():
    """50 scans there, and the same way back, 10 m apart."""
    x = np.concatenate([np.arange(0, 500, 10.0), np.arange(490, -10, -10.0)])
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    poses[:, 0, 3] = x
    poses[50:, :2, :2] *= -1  # turned round
    return Session("road", tuple(range(len(x))), poses, poses[:, :2, 3], None, lambda _: None)


def test_local_maps_that_revisit_are_found_by_right_closures(benchmark, monkeypatch):
    loops = benchmark("peer_loops")
    session = drive()
    borders = [(0, 26), (25, 50), (49, 75), (74, 100)]
    true = lambda a, b: np.linalg.inv(session.poses[a]) @ session.poses[b]  # noqa: E731
    off = pose_from(np.eye(3), [0, 3.0, 0])
    closures = [
        loops.Closure(0, 3, true(0, 74)),
        loops.Closure(1, 2, true(25, 49) @ off),  # right to 4 m
        loops.Closure(0, 2, np.linalg.inv(true(0, 49))),  # misread
    ]
    revisiting = {k: np.array([99 - k]) for k in range(60, 100)}
    row = loops.closures_row("road", session, closures, borders, revisiting, 2.0)
    assert (row.loops, row.of, row.ms) == (3, "4 local maps", 500.0)
    assert (row.right.good, row.right_to_4_m.good) == (1, 2)
    assert (row.keyframes_found.good, row.keyframes_found.of) == (25, 40)
    assert (row.maps_found.good, row.maps_found.of) == (1, 2)
    assert row.in_reach.of == 0  # the last may be compared with none: all are among three before
    monkeypatch.setattr(loops, "SKIPPED", 2)
    row = loops.closures_row("road", session, closures, borders, revisiting, 2.0)
    assert (row.in_reach.good, row.in_reach.of) == (25, 25)

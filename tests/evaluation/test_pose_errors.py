"""Errors of relative poses: frames, turns of scans, and what is counted."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, planar_pose, pose_from, rotation_from_rpy
from deepring.data.scan_set import ScanSet
from deepring.data.session import Session
from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.evaluation.pose_errors import (
    COLUMNS,
    PoseErrors,
    planar_errors,
    pose_errors,
    write_pose_errors,
)
from deepring.evaluation.protocol import evaluate_method
from deepring.methods.ring import Ring
from deepring.rasters import BevRaster, PointsRaster
from deepring.reports.pose_errors_table import markdown_poses
from helpers.drives import road_task

CASE = Case("SSC", "", "road", "test")


def scan_set(poses, points, turns=None, ground_z=-1.5):
    files = tuple(range(len(poses)))
    session = Session("drive", files, poses, poses[:, :2, 3], None, points.__getitem__)
    return ScanSet(session, np.arange(len(poses)), ground_z, turns)


def test_frames_are_those_of_the_points_that_a_raster_has():
    rng = np.random.default_rng(0)
    world = np.array([100.0, 50.0, 0.0]) + rng.uniform(-5, 5, (64, 3))
    angles = rng.uniform(-0.1, 0.1, (2, 2)), [0.3, 2.0]
    poses = pose_from(
        rotation_from_rpy(*angles[0].T, angles[1]), [[99.0, 51.0, 1.5], [101.0, 48.0, 1.4]]
    )
    points = [moved_points(world, np.linalg.inv(pose)).astype(np.float32) for pose in poses]
    raster = PointsRaster(count=64)
    turns = np.array([0.0, 1.2])
    scans = scan_set(poses, points, turns)
    assert scans.frames.shape == (2, 4, 4)
    for k, pose in enumerate(scans.frames):
        turned = planar_pose(0, 0, turns[k])
        seen = moved_points(points[k], turned) - [0, 0, scans.ground_z]
        np.testing.assert_allclose(moved_points(seen, pose), world, atol=1e-4)
        shown = 70 * scans.rasterize(k, replace(raster, preprocessing=whole())).astype(float)
        assert np.linalg.norm(shown[:, None] - seen[None], axis=-1).min(axis=1).max() < 0.05
    # The usual misreading: the pose turned with the points, not against them.
    wrong = poses[1] @ planar_pose(0, 0, turns[1], scans.ground_z)
    assert np.abs(scans.frames[1] - wrong).max() > 0.5


def whole():
    return replace(PointsRaster().preprocessing, clearance=None)


def test_errors_are_of_the_query_in_the_frame_of_the_place():
    true = planar_pose(3.0, 1.0, math.radians(100))[None]
    told = planar_pose(3.0, 2.0, math.radians(97))[None]
    metres, degrees = planar_errors(told, true)
    position, off = (np.linalg.inv(pose[0])[:2, 3] for pose in (true, told))
    assert metres == pytest.approx(np.linalg.norm(position - off))
    assert degrees == pytest.approx(3.0)
    assert np.max(planar_errors(true, true)) < 1e-9
    # The usual misreading, a pose the other way round, is far off.
    metres, degrees = planar_errors(np.linalg.inv(true), true)
    assert degrees == pytest.approx(160.0)
    assert metres > 2


def test_heights_and_tilts_do_not_count_and_what_is_not_told_is_infinitely_off():
    true = pose_from(rotation_from_rpy(0.02, -0.03, 3.1), [1.0, 2.0, 0.4])[None]
    level = planar_pose(1.0, 2.0, 3.1 - 2 * math.pi)[None]
    metres, degrees = planar_errors(level, true)
    assert metres < 0.1
    assert degrees < 0.1
    untold = planar_errors(np.full((1, 4, 4), np.nan), true)
    assert np.isinf(untold).all()


class Told(Ring):
    """RING, which tells relative poses that are written down."""

    def __init__(self, told):
        super().__init__(BevRaster(), angles=24, bins=24)
        self._told = told

    def relative_poses(self, query, places):
        assert query.shape == self.raster.shape
        assert places.shape == (1, *self.raster.shape)
        return self._told[: len(places)]


def test_poses_are_asked_of_the_best_places_that_are_right():
    turned_by = torch.eye(4, dtype=torch.float64)[None]
    method = Told(turned_by)
    task = road_task(method.raster, turned=True, away=3.0)
    outcome = evaluate_method(task.case("RING"), method, task)
    matches, steps = outcome.matches, []
    errors = pose_errors(method, task, matches, 10.0, lambda *n: steps.append(n))
    (found,) = np.nonzero(matches.distance[:, 0] <= 10)
    assert 0 < len(found) < len(matches.query)
    assert steps[-1] == (len(found), len(found))
    # "Nothing has moved" is off by what the truth says: the distance, and the query's turn.
    np.testing.assert_allclose(errors.metres, matches.distance[found, 0], rtol=1e-3)
    turns = task.scans.query.turns[found]
    np.testing.assert_allclose(
        errors.degrees, np.degrees(np.abs((turns + np.pi) % (2 * np.pi) - np.pi)), atol=1e-6
    )
    assert errors.right == int(((errors.metres < 2) & (errors.degrees < 5)).sum())
    with pytest.raises(DataError, match=r"relative_poses: shape \(0, 4, 4\), expected \(1, 4, 4"):
        pose_errors(Told(turned_by[:0]), task, matches, 10.0)


def test_a_table_and_a_file_state_them(tmp_path):
    several = PoseErrors(CASE, 10.0, np.array([0.5, 1.0, 3.0, np.inf]), np.array([1.0, 6, 1, 9]))
    none = PoseErrors(replace(CASE, method="DH3D", train="sim"), 10.0, np.zeros(0), np.zeros(0))
    lost = PoseErrors(replace(CASE, method="lost"), 10.0, np.full(3, np.inf), np.full(3, np.inf))
    lines = markdown_poses([several, none, lost]).splitlines()
    assert lines[0] == "road test: relative poses of the best places within 10 m"
    assert lines[2] == (
        "| method | trained on | places | within 2 m and 5° | median m | median ° |"
    )
    assert lines[4:7] == [
        "| SSC | - | 4 | 0.250 (.05-.70) | 2.00 | 3.50 |",
        "| DH3D | sim | 0 | - | - | - |",
        "| lost | - | 3 | 0.000 (.00-.56) | - | - |",
    ]
    write_pose_errors(tmp_path / "poses.csv", [several, none])
    with (tmp_path / "poses.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == list(COLUMNS)
    assert rows[1] == ["SSC", "", "road", "test", "10.0", "4", "1", "2.0", "3.5"]
    assert rows[2][-4:] == ["0", "0", "inf", "inf"]

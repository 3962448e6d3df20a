"""Poses refined on points: a known transform, misreadings, runaways, and a real pair."""

import math
import sys

import numpy as np
import pytest
import torch

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.readers.kitti import read_kitti_scan
from deepring.errors import DeepringError
from deepring.localization.candidates import RerankSettings, align_candidates
from deepring.localization.registration.refinement import RefinementSettings, refine, start_of
from deepring.rasters import BevRaster
from helpers.real_data import real_data


def street(seed=0):
    """Ground, walls and poles (n, 3), metres, as a sensor 1.8 m above the ground sees them."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform([-40, -40, -1.8], [40, 40, -1.8], (6000, 3))
    walls = []
    for x, y, heading, length in ((0, 14, 0.05, 50), (5, -11, -0.1, 40), (28, 2, 1.5, 25)):
        along, up = rng.uniform(-length / 2, length / 2, 2500), rng.uniform(-1.8, 5, 2500)
        walls.append(np.c_[x + along * math.cos(heading), y + along * math.sin(heading), up])
    poles = []
    for x, y in rng.uniform(-30, 30, (25, 2)):
        around, up = rng.uniform(0, 2 * math.pi, 80), rng.uniform(-1.8, 3, 80)
        poles.append(np.c_[x + 0.2 * np.cos(around), y + 0.2 * np.sin(around), up])
    points = np.concatenate([ground, *walls, *poles])
    return (points + rng.normal(0, 0.02, points.shape)).astype(np.float32)


def seen_by(pose, points):
    """Points of the map scan's frame in that of a sensor at ``pose`` (4, 4)."""
    return ((points - pose[:3, 3]) @ pose[:3, :3]).astype(np.float32)


def degrees_between(a, b):
    return abs(math.degrees((a - b + math.pi) % (2 * math.pi) - math.pi))


REFERENCE, AGAIN = street(), street()[::2]
POSES = [(3.0, -2.0, 0.6), (-4.0, 1.0, -2.4), (0.5, 6.0, 3.1)]


@pytest.mark.parametrize(("x", "y", "heading"), POSES)
def test_a_known_transform_is_recovered(x, y, heading):
    truth = pose_from(rotation_from_rpy(0.02, -0.03, heading), [x, y, 0.15])
    query = seen_by(truth, AGAIN)
    off = (x + 0.8, y - 0.6)
    found = refine(query, REFERENCE, -heading + math.radians(3), off)
    assert found.converged
    assert found.inliers > 0.9
    assert np.linalg.norm(found.transform[:3, 3] - truth[:3, 3]) < 0.1
    assert np.hypot(*(found.position - [x, y])) < 0.1
    assert degrees_between(found.turn, -heading) < 0.5
    # All of it, not the planar part alone: roll, pitch and height, too.
    assert np.abs(found.transform - truth).max() < 0.05
    moved = query @ found.transform[:3, :3].T + found.transform[:3, 3]
    assert np.abs(moved - AGAIN).max() < 0.3


@pytest.mark.parametrize(("x", "y", "heading"), POSES[:2])
def test_the_sensors_heading_is_no_start(x, y, heading):
    truth = pose_from(rotation_from_rpy(0, 0, heading), [x, y, 0])
    query = seen_by(truth, AGAIN)
    right = refine(query, REFERENCE, -heading, (x, y))
    misread = refine(query, REFERENCE, heading, (x, y))
    assert right.converged
    assert not misread.converged or degrees_between(misread.turn, -heading) > 20
    assert misread.inliers < 0.8 * right.inliers


def test_what_runs_away_is_not_believed_and_the_start_kept():
    truth = pose_from(np.eye(3), [1.5, 0, 0])
    query = seen_by(truth, AGAIN)
    far = refine(query, REFERENCE, 0.0, (0, 0))
    assert far.converged
    assert far.position == pytest.approx([1.5, 0], abs=0.1)
    held = refine(query, REFERENCE, 0.0, (0, 0), RefinementSettings(max_shift=1.0))
    assert not held.converged
    assert np.array_equal(held.transform, np.eye(4))
    assert (held.turn, *held.position) == (0.0, 0.0, 0.0)
    turned = RefinementSettings(max_turn=math.radians(1))
    held = refine(query, REFERENCE, math.radians(4), (1.5, 0), turned)
    assert not held.converged
    assert held.turn == pytest.approx(math.radians(4))


def test_scans_that_share_nothing_keep_the_start():
    found = refine(AGAIN + np.float32([500, 0, 0]), REFERENCE, 0.3, (1, 2))
    assert not found.converged
    assert found.inliers == 0
    assert math.isinf(found.error)
    assert np.allclose(found.transform, start_of(0.3, (1, 2)))
    one = refine(AGAIN[:1], REFERENCE[:1], 0.3, (1, 2))
    assert np.isfinite(one.transform).all()


def test_missing_returns_are_dropped():
    holes = np.insert(AGAIN, 3, [[np.nan, 0, 0], [0, 0, 0], [np.inf, 1, 1]], axis=0)
    filled, whole = (refine(points, REFERENCE, 0.3, (1.0, 0.5)) for points in (holes, AGAIN))
    np.testing.assert_array_equal(filled.transform, whole.transform)


def test_mistakes_are_named(monkeypatch):
    for name, value in {"voxel": 0, "iterations": 0, "max_shift": -1, "max_turn": math.nan}.items():
        with pytest.raises(DeepringError, match=rf"refinement\.{name}: "):
            RefinementSettings(**{name: value})
    for reaches in ((), (2.0, 0.0)):
        with pytest.raises(DeepringError, match=r"refinement\.reaches"):
            RefinementSettings(reaches=reaches)
    with pytest.raises(DeepringError, match="query: no points"):
        refine(AGAIN[:0], REFERENCE, 0, (0, 0))
    with pytest.raises(DeepringError, match=r"reference: shape \(\d+, 2\), expected \(n, 3\)"):
        refine(AGAIN, REFERENCE[:, :2], 0, (0, 0))
    with pytest.raises(DeepringError, match="turn: nan, expected a finite number of radians"):
        refine(AGAIN, REFERENCE, math.nan, (0, 0))
    for position in ((0, math.inf), (0, 0, 0), "ab", (1j, 0)):
        with pytest.raises(DeepringError, match="position: "):
            refine(AGAIN, REFERENCE, 0, position)
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    with pytest.raises(DeepringError, match=r"pip install 'deepring\[refine\]'"):
        refine(AGAIN, REFERENCE, 0, (0, 0))


def test_a_real_pair_is_aligned_as_its_points_say():
    """The pair's published poses drift: the registration of the points is the judge."""
    place, query = (
        read_kitti_scan(real_data("kitti08_pair", f"{number}.bin"))
        for number in ("000720", "001500")
    )
    raster = BevRaster()
    images = [torch.from_numpy(raster(points, -1.73)) for points in (place, query)]
    aligned = align_candidates(images[1], None, images[0][None], RerankSettings())
    turn, position = float(aligned.turn[0]), aligned.position[0].numpy()
    points = refine(query, place, turn, position)
    assert points.converged
    assert points.inliers > 0.75
    assert np.hypot(*(points.position - position)) < 2
    assert degrees_between(points.turn, turn) < 5
    assert degrees_between(points.turn, math.radians(148.5)) < 1
    # No such agreement from the opposite heading, or where the turn's sign is misread.
    for wrong in (turn + math.pi, -turn):
        other = refine(query, place, wrong, position)
        assert not other.converged
        assert other.inliers < 0.5
    # A start that is off by 2 m and 5° comes to the same pose.
    again = refine(query, place, turn + math.radians(5), position + np.array([1.6, -1.2]))
    assert np.hypot(*(again.position - points.position)) < 0.05
    assert degrees_between(again.turn, points.turn) < 0.1

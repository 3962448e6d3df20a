"""Semantic Scan Context against plain loops; worked examples; turns, offsets and their signs."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, planar_pose, turn_points
from deepring.errors import ConfigError, DataError
from deepring.methods.method import RelativePoses, rebuild_method
from deepring.methods.ssc import Ssc
from deepring.methods.ssc._ssc_kernels import share_alike
from deepring.methods.ssc.ssc_keys import label_keys
from deepring.rasters import SemanticPointsRaster, SemanticRaster
from deepring.rasters.classes import PRIORITY
from deepring.testing import check_method, walls, with_columns

SMALL = SemanticPointsRaster(sectors=60, rings=10, count=600)
METHOD = Ssc()


def street(seed, count=4000):
    """Points on walls with labels, and the ground around."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-45, 45, (count, 2)), np.zeros(count)])
    labels = np.full((count, 1), 40.0)
    walled = with_columns(walls(seed, radius=40.0), ["label"])
    return np.concatenate([walled, np.hstack([ground, labels])]).astype(np.float32)


def turned(points, degrees, x=0.0, y=0.0):
    """The points turned counter-clockwise, then moved."""
    result = points.copy()
    result[:, :3] = turn_points(points[:, :3], math.radians(degrees))
    return result + np.float32([x, y, 0, 0])


def described(method, *scans):
    rasters = np.stack([method.raster(points, 0.0) for points in scans])
    return method.describe(torch.from_numpy(rasters))


def align_by_loop(query, entry, raster, match_labels=True, window=20):
    """Score, roll, x and y of one pair, as the paper has it."""
    sectors, rings = raster.sectors, raster.rings
    query, entry = query.double().numpy(), entry.double().numpy()
    marks, other = query[:sectors], entry[:sectors]

    def ranges(marks):
        return np.rint(1000 * np.where(marks[:, 2] > 0, np.hypot(marks[:, 0], marks[:, 1]), 0))

    distances = [
        np.abs(ranges(marks) - np.roll(ranges(other), roll)).sum() for roll in range(sectors)
    ]
    roll = int(np.argmin(distances))
    turn = 2 * math.pi * roll / sectors
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    moved = np.roll(other, roll, axis=0)
    moved[:, :2] = moved[:, :2] @ rotation.T
    offset = np.zeros(2)
    for _ in range(100):
        steps = []
        for k in range(sectors):
            near = [moved[j % sectors] for j in range(k - window // 2, k + window // 2 + 1)]
            near = [m for m in near if m[2] > 0 and (m[2] == marks[k, 2] or not match_labels)]
            if marks[k, 2] == 0 or not near:
                continue
            ways = np.array([marks[k, :2] - m[:2] - offset for m in near])
            way = ways[(ways**2).sum(axis=1).argmin()]
            if (np.abs(way) < 3).all():
                steps.append(way)
        if not steps:
            break
        step = np.mean(steps, axis=0)
        offset = offset + step
        if (np.abs(step) < 1e-5).all():
            break
    if (np.abs(offset) > 5).any():
        offset = np.zeros(2)
    images = []
    for points, matrix, shift in ((query, np.eye(2), np.zeros(2)), (entry, rotation, offset)):
        image = np.zeros((sectors, rings), dtype=np.uint8)
        for row in points[sectors:]:
            number, (x, y) = row[2], matrix @ row[:2] + shift
            ring = int(math.hypot(x, y) / raster.radius * rings)
            sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * sectors) % sectors
            rank = PRIORITY[int(number)]
            if ring < rings and rank > image[sector, ring]:
                image[sector, ring] = rank
        images.append(image)
    filled = (images[0] > 0) | (images[1] > 0)
    alike = (images[0] == images[1]) & filled
    return alike.sum() / max(1, filled.sum()), roll, *offset


@pytest.mark.parametrize("match_labels", [True, False])
def test_pairs_are_aligned_and_compared_as_a_loop_does(match_labels):
    method = Ssc(SMALL, match_labels=match_labels, window=10)
    scans = [street(0), turned(street(0), 42, 1.5, -0.7), street(1), turned(street(2), 200)]
    descriptors = described(method, *scans)
    score, turn = method.compare(descriptors, descriptors)
    moved = 0
    for i in range(4):
        for j in range(4):
            expected, roll, x, y = align_by_loop(
                descriptors[i], descriptors[j], SMALL, match_labels, 10
            )
            found = method.align(descriptors[i], descriptors[j])
            assert found.offset == pytest.approx((x, y), abs=1e-4)
            # A point within rounding of a border may fall to either side.
            assert float(score[i, j]) == pytest.approx(expected, abs=0.005)
            away = (float(turn[i, j]) - 2 * math.pi * roll / 60) % (2 * math.pi)
            assert min(away, 2 * math.pi - away) < 1e-4
            assert found.score == pytest.approx(float(score[i, j]))
            moved += abs(x) > 0.1
    assert moved > 2


def test_the_worked_example():
    query = np.array([[13, 0, 16, 0]], dtype=np.uint8)
    entry = np.array([[13, 18, 0, 0]], dtype=np.uint8)
    assert share_alike(query, entry) == pytest.approx(1 / 3)
    assert share_alike(np.zeros_like(query), np.zeros_like(query)) == 0.0  # never 0 / 0


@pytest.mark.parametrize("degrees", [0, 1, 90, 213])
def test_a_scan_turned_by_whole_degrees_is_itself(degrees):
    points = street(3)
    entry, query = described(METHOD, points, turned(points, degrees))
    found = METHOD.align(query, entry)
    assert found.score > (0.999 if degrees == 0 else 0.97)  # stored to 1.5 mm
    away = (found.turn - math.radians(degrees)) % (2 * math.pi)
    assert min(away, 2 * math.pi - away) < 1e-5  # counter-clockwise, from entry to query
    assert np.abs(found.offset).max() < 0.02
    if degrees == 90:
        opposite = METHOD.align(entry, query)
        assert opposite.turn == pytest.approx(-math.pi / 2, abs=1e-5)


@pytest.mark.parametrize(("degrees", "x", "y"), [(0, 1.0, 0.5), (30, -1.2, 0.4), (180, 0.6, 1.0)])
def test_a_moved_scan_is_found_within_a_cell(degrees, x, y):
    points = street(4)
    entry, query = described(METHOD, points, turned(points, degrees, x, y))
    found = METHOD.align(query, entry)
    assert math.hypot(found.offset[0] - x, found.offset[1] - y) < 1.0
    other = METHOD.align(query, described(METHOD, street(5))[0])
    assert found.score > 1.2 * other.score


def test_thinned_points_are_as_alike_as_whole_scans():
    for query, entry in ((street(0), turned(street(0), 70, 1.0, -0.5)), (street(0), street(1))):
        found = METHOD.align(*described(METHOD, query, entry))
        moved = turned(entry, math.degrees(found.turn), *found.offset)
        images = [SemanticRaster()(points, 0.0) for points in (query, moved)]
        filled = (images[0] > 0) | (images[1] > 0)
        whole = (filled & (images[0] == images[1])).sum() / filled.sum()
        assert found.score == pytest.approx(whole, abs=0.015)


def test_relative_poses_carry_the_points_of_a_place_onto_the_querys():
    points, truth = street(4), planar_pose(-1.2, 0.4, math.radians(30))
    seen = points.copy()
    seen[:, :3] = moved_points(points[:, :3], truth)
    query, *places = (torch.from_numpy(METHOD.raster(p, 0.0)) for p in (seen, points, seen))
    moved, same = METHOD.relative_poses(query, torch.stack(places)).numpy()
    assert isinstance(METHOD, RelativePoses)
    assert moved.dtype == np.float64
    away = np.linalg.norm(moved_points(points[:, :3], moved) - seen[:, :3], axis=1)
    assert np.median(away) < 1.5  # turned to whole degrees
    # The usual misreading: the query's points carried onto the place's.
    opposite = np.linalg.inv(moved)
    wrong = np.linalg.norm(moved_points(points[:, :3], opposite) - seen[:, :3], axis=1)
    assert np.median(wrong) > 5
    assert np.linalg.norm(moved[:2, 3] - truth[:2, 3]) < 1.0
    assert np.abs(same - np.eye(4)).max() < 1e-6


def test_a_scan_without_landmarks_has_no_relative_pose():
    ground = street(0)[-4000:]  # nothing that stands
    query, blank = (torch.from_numpy(METHOD.raster(p, 0.0)) for p in (street(0), ground))
    assert METHOD.relative_poses(query, torch.stack([blank, query]))[:, 0, 0].isnan().tolist() == [
        True,
        False,
    ]
    assert METHOD.relative_poses(blank, query[None]).isnan().all()
    assert METHOD.relative_poses(query, query[None][:0]).shape == (0, 4, 4)


def test_offsets_that_are_far_are_none():
    rng = np.random.default_rng(0)
    base = np.column_stack([rng.uniform(-40, 40, (300, 2)), np.zeros(300), np.full(300, 50.0)])
    for seed in range(5):
        other = base + np.column_stack([rng.normal(0, 4, (300, 2)), np.zeros((300, 2))])
        pair = described(METHOD, base.astype("f4"), other.astype("f4"))
        assert np.abs(METHOD.align(*pair).offset).max() <= 5.0, seed


def test_a_car_that_drives_away_changes_nothing():
    points = street(6)
    car = np.column_stack(
        [np.random.default_rng(0).uniform(8, 12, (200, 2)), np.zeros(200), np.full(200, 10.0)]
    ).astype(np.float32)
    empty, full = described(METHOD, points, np.concatenate([points, car]))
    assert torch.equal(empty, full)


def test_scans_without_anything_that_counts_are_unlike_all():
    blank = np.zeros((1, *METHOD.raster.shape), dtype=np.int16)
    nothing, something = METHOD.describe(blank), described(METHOD, street(0))
    assert METHOD.compare(nothing, nothing).score.tolist() == [[0.0]]
    assert METHOD.compare(nothing, something).score.tolist() == [[0.0]]
    assert torch.isfinite(label_keys(nothing, METHOD.pair_settings)).all()


def test_it_is_a_method():
    small = SemanticPointsRaster(sectors=120, rings=20, count=2000)
    for method in (Ssc(small), Ssc(small, candidates=3, match_labels=False, window=9)):
        assert check_method(method) == {}
    assert rebuild_method({"method": "ssc", "raster": {"kind": "semantic_points"}, "values": {}})


def test_candidates_are_those_of_like_classes_at_like_distances():
    method = Ssc(SMALL, candidates=2)
    scans = [street(seed) for seed in range(5)]
    places = described(method, *scans)
    queries = described(method, *(turned(points, 70) for points in scans))
    score, turn = method.compare(queries, places)
    every = Ssc(SMALL).compare(queries, places).score
    aligned = score >= 0
    assert aligned.sum(dim=1).tolist() == [2] * 5
    assert aligned.diagonal().all()  # no turn changes a key
    assert torch.equal(score[aligned], every[aligned])
    assert turn[~aligned].isnan().all()
    hits = method.index().search(queries[:1])
    assert hits.place.shape == (1, 0)


def test_wrong_settings_and_descriptors_are_named():
    for name, value in (("candidates", 0), ("match_labels", 1), ("window", 0), ("raster", 3)):
        with pytest.raises(ConfigError, match=f"SSC: {name}: "):
            Ssc(**{name: value})
    places = described(METHOD, street(0))
    with pytest.raises(DataError, match=r"queries: shape \(1, 9, 3\), expected \(n, 12648, 3\)"):
        METHOD.compare(places[:, :9], places[:, :9])
    wrong = places.clone()
    wrong[0, 5, 2] = 20
    with pytest.raises(DataError, match="database: a class 20, expected 0 to 19"):
        METHOD.compare(places, wrong)

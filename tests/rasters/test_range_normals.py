"""Range images with normals: worked examples, plain loops, turns; and overlaps of two scans."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, planar_pose, turn_points
from deepring.errors import ConfigError
from deepring.rasters import RangeNormalRaster, make_raster, raster_settings
from deepring.testing import walls

PUBLISHED = RangeNormalRaster(viewpoint=0.0)
SMALL = RangeNormalRaster(sectors=60, rows=12, elevation=(-25, 30), viewpoint=1.8)


def scan(seed):
    """Walls, and the ground around."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack([rng.uniform(-30, 30, (3000, 2)), np.zeros(3000)])
    return np.concatenate([walls(seed, radius=40.0), ground]).astype(np.float32)


@pytest.mark.parametrize(
    ("point", "column", "row", "distance"),
    [
        ((10, 0, 0), 450, 6, 10.0),
        ((0, 10, -1), 225, 19, 10.04988),
        ((-10, 0.001, -3), 0, 45, 10.44031),
    ],
)
def test_points_fall_where_the_published_image_has_them(point, column, row, distance):
    image = PUBLISHED(np.float32([point]), 0.0)
    ((sector, height),) = np.argwhere(image[0] > 0)
    # There columns go clockwise from the back, and rows from the top.
    assert height == 63 - row
    assert (sector + column - 450) % 900 in (0, 899)
    assert float(image[0, sector, height]) == pytest.approx(distance, rel=1e-3)
    assert (image[1:] == -1).all()


def test_the_nearest_return_counts_as_in_a_loop():
    points = scan(0)
    expected = np.full((60, 12), np.inf)
    for x, y, z in points.astype(np.float64):
        away = math.sqrt(x**2 + y**2 + (z - 1.8) ** 2)
        pitch = math.degrees(math.atan2(z - 1.8, math.hypot(x, y)))
        row = math.floor((pitch + 25) / 55 * 12)
        sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * 60) % 60
        if 0 <= row < 12 and away < 50:
            expected[sector, row] = min(expected[sector, row], away)
    image = SMALL(points, 0.0)
    expected[np.isinf(expected)] = -1
    np.testing.assert_allclose(image[0].astype(float), expected, rtol=1e-3)
    assert SMALL.is_blank(SMALL(points[:0], 0.0))
    assert not SMALL.is_blank(image)


def test_flat_ground_and_a_wall_have_normals_that_look_at_the_sensor():
    azimuth, pitch = np.meshgrid(
        np.radians(np.arange(0, 360, 0.2)), np.radians(np.arange(-24, 29, 0.5))
    )
    rays = np.stack(
        [np.cos(pitch) * np.cos(azimuth), np.cos(pitch) * np.sin(azimuth), np.sin(pitch)]
    )
    rays = rays.reshape(3, -1).T
    ground = rays[rays[:, 2] < -0.1] * (-1.8 / rays[rays[:, 2] < -0.1, 2])[:, None] + [0, 0, 1.8]
    image = SMALL(ground.astype(np.float32), 0.0).astype(float)
    known = (image[1:] != -1).any(axis=0)
    assert known[:, 1:3].all()
    np.testing.assert_allclose(image[3][known], 1.0, atol=1e-3)
    ahead = rays[rays[:, 0] > 0.5]
    wall = ahead * (5.0 / ahead[:, 0])[:, None] + [0, 0, 1.8]
    image = SMALL(wall.astype(np.float32), 0.0).astype(float)
    known = (image[1:] != -1).any(axis=0)
    assert known.sum() > 50
    assert not known[:, 0].any()  # there is nothing below
    np.testing.assert_allclose(image[1][known], -1.0, atol=1e-3)


@pytest.mark.parametrize("normals", ["sensor", "radial"])
def test_a_turned_image_is_that_of_the_turned_scan(normals):
    raster = make_raster({**raster_settings(SMALL), "normals": normals})
    points = scan(1)
    image = torch.from_numpy(raster(points, 0.0))[None]
    turned = raster.turned(image, torch.tensor([5]))[0].numpy()
    seen = raster(turn_points(points, 5 * 2 * math.pi / 60), 0.0)
    alike = np.abs(turned.astype(float) - seen.astype(float)).max(axis=0) < 0.01
    assert alike.mean() > 0.98  # a point may fall to the other side of a border
    rolled = np.roll(image[0].numpy(), 5, axis=1)
    plain = np.abs(rolled.astype(float) - seen.astype(float)).max(axis=0) < 0.01
    assert (plain.mean() > 0.98) == (normals == "radial")


def overlap_by_loop(raster, first, second, pose, around, tolerance=1.0):
    low, high = raster.elevation
    seen = {}
    for s, r in np.argwhere(second > 0):
        azimuth = 2 * math.pi * (s + 0.5) / raster.sectors
        pitch = math.radians(low + (r + 0.5) * (high - low) / raster.rows)
        ray = [
            math.cos(pitch) * math.cos(azimuth),
            math.cos(pitch) * math.sin(azimuth),
            math.sin(pitch),
        ]
        ((x, y, z),) = moved_points(second[s, r] * np.array([ray]), pose)
        away, height = (
            math.sqrt(x * x + y * y + z * z),
            math.degrees(math.atan2(z, math.hypot(x, y))),
        )
        row = math.floor((height - low) / (high - low) * raster.rows)
        sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * raster.sectors)
        if 0 <= row < raster.rows and away < raster.max_range:
            seen[sector, row] = min(seen.get((sector, row), np.inf), away)
    valid = np.argwhere(first > 0)
    steps = range(-around, around + 1)
    alike = [
        any(
            abs(seen.get(((s + i) % raster.sectors, r + j), np.inf) - first[s, r]) < tolerance
            for i in steps
            for j in steps
        )
        for s, r in valid
    ]
    return float(np.mean(alike))


def test_overlaps_are_those_of_a_loop_and_fall_with_the_distance():
    points = scan(2)
    moves = [
        planar_pose(0, 0, 0),
        planar_pose(2, 1, 0.7),
        planar_pose(-9, 4, -2),
        planar_pose(120, 0, 0),
    ]
    # A scan from elsewhere: its points, carried by the pose, are those of the first.
    scans = [moved_points(points, np.linalg.inv(move)).astype(np.float32) for move in moves]
    ranges = np.stack([SMALL(each, 0.0)[0] for each in scans]).astype(np.float32)
    ranges[3] = ranges[0]
    pairs = np.array([[0, k] for k in range(4)])
    strict, found = (SMALL.overlaps(ranges, pairs, np.stack(moves), 1.0, n) for n in (0, 1))
    for around, values in enumerate((strict, found)):
        for k, move in enumerate(moves):
            expected = overlap_by_loop(SMALL, ranges[0], ranges[k], move, around)
            assert values[k] == pytest.approx(expected, abs=0.005)
    assert strict[0] == found[0] == 1.0
    assert (found >= strict).all()
    assert found[3] == 0.0
    assert 1 > found[1] > found[2] > 0
    # The usual misreading, the pose the other way round, overlaps less.
    (wrong,) = SMALL.overlaps(ranges, pairs[1:2], np.linalg.inv(moves[1])[None])
    assert wrong < found[1] - 0.1
    blank = np.full_like(ranges[:1], -1)
    assert SMALL.overlaps(blank, np.zeros((1, 2)), np.eye(4)[None]).tolist() == [0.0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rows": 0}, "raster.rows: 0"),
        ({"max_range": 0.0}, "raster.max_range: 0"),
        ({"max_range": 300.0}, "preprocessing.extent: 200 m"),
        ({"elevation": (-100.0, 3.0)}, r"raster.elevation: \[-100.0, 3.0\], expected"),
        ({"normals": "world"}, "raster.normals: 'world', expected"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        RangeNormalRaster(**settings)

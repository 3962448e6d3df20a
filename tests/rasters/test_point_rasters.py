"""Points, voxels and layers of height: fixed shapes, the order of the points, padding, turns."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters import HeightRaster, PointsRaster, Preprocessing, VoxelRaster
from deepring.rasters.downsample import SURPLUS, fixed_count, spread, voxel_means, voxel_size
from deepring.rasters.heights import polar_layers
from deepring.rasters.polar import polar_gram
from deepring.rasters.voxels import PADDING, cylindrical_voxels
from helpers.scenes import scattered

EVERYTHING = Preprocessing(height=(-60.0, 60.0), clearance=None)


def cloud(n, seed=0, reach=45.0):
    """Points in a box inside the disc of 70 m, each at a height of its own in [-5, 35)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-reach, reach, (n, 3))
    points[:, 2] = rng.permutation(n) * 40 / max(n, 1) - 5
    return points.astype(np.float32)


def shuffled(points, seed=1):
    return np.random.default_rng(seed).permutation(points)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 50), st.integers(1, 120))
def test_spread_takes_each_index_as_often_as_any_other(n, count):
    chosen = spread(n, count)
    times = np.bincount(chosen, minlength=n)
    assert len(chosen) == count
    assert (np.diff(chosen) >= 0).all()
    assert times.max() - times.min() <= 1
    if n >= count:  # no long gap anywhere
        gaps = np.diff(np.append(chosen, n + chosen[0]))
        assert gaps.max() - gaps.min() <= 1


def test_voxel_means_against_a_loop():
    points, size = cloud(400), 15.0
    groups = {}
    for point in points:
        groups.setdefault(tuple(np.floor(point / size)), []).append(point.astype(float))
    expected = [np.mean(groups[key], axis=0) for key in sorted(groups)]
    assert np.allclose(voxel_means(points, size), expected, atol=1e-5)


@pytest.mark.parametrize("count", [50, 400, 1500])
def test_the_voxel_size_leaves_just_at_least_the_count(count):
    points = cloud(3000)
    size = voxel_size(points, count)
    assert count <= len(voxel_means(points, size)) <= max(SURPLUS * count, count + 3)
    assert len(voxel_means(points, 1.1 * size)) < count


def test_points_that_coincide_have_no_voxel_size_and_are_repeated():
    points = np.repeat(cloud(5), 20, axis=0)
    assert voxel_size(points, 30) is None
    chosen, times = np.unique(fixed_count(points, 30), axis=0, return_counts=True)
    assert np.array_equal(chosen, np.unique(cloud(5), axis=0))
    assert times.tolist() == [6] * 5


@pytest.mark.parametrize("n", [0, 1, 7, 63, 64, 65, 900])
def test_points_come_in_any_number_and_leave_as_many_as_wanted(n):
    raster = PointsRaster(count=64, preprocessing=EVERYTHING)
    image = raster(cloud(n), 0.0)
    assert image.shape == raster.shape == (64, 3)
    assert image.dtype == np.float16
    assert np.abs(image).max() <= 1
    distinct, times = np.unique(image, axis=0, return_counts=True)
    assert len(distinct) == (1 if n == 0 else min(n, 64))
    assert times.max() - times.min() <= 1
    if n <= 64:  # none is left out, and each is where it was
        metres = np.sort(distinct[:, 2].astype(float)) * 70
        expected = np.sort(cloud(n)[:, 2]) if n else [0.0]
        assert np.allclose(metres, expected, atol=0.0086)


@pytest.mark.parametrize("n", [40, 3000])
@pytest.mark.parametrize(
    "raster",
    [
        PointsRaster(count=256, preprocessing=EVERYTHING),
        PointsRaster(count=256),
        VoxelRaster(max_voxels=200, preprocessing=EVERYTHING),
        VoxelRaster(max_voxels=5000),
        HeightRaster(),
    ],
    ids=["points", "points without ground", "voxels cut", "voxels", "heights"],
)
def test_the_order_of_the_points_does_not_matter(raster, n):
    image = raster(cloud(n), -1.0)
    assert image.any()
    assert np.array_equal(image, raster(cloud(n), -1.0))
    for seed in range(3):
        assert np.array_equal(image, raster(shuffled(cloud(n), seed), -1.0))
    assert np.array_equal(image, raster(cloud(n)[::-1], -1.0))


def test_points_are_scaled_by_the_extent_to_the_stated_error():
    points = cloud(500, reach=49.0)
    image = PointsRaster(count=500, preprocessing=EVERYTHING)(points, -2.0).astype(float) * 70
    expected = points[np.lexsort(points.T[::-1])] + [0, 0, 2]
    error = np.abs(image - expected)
    assert error.max() <= 0.0172
    assert error[np.abs(expected) < 35].max() <= 0.0086
    assert error.max() > 0.008  # float16 it is


def test_points_and_voxels_beyond_the_disc_are_left_out():
    inside = cloud(30)
    outside = np.array([[60, 60, 1], [50, -50, 1], [-69, 30, 1]], np.float32)
    both = np.concatenate([outside, inside])
    for raster in (
        PointsRaster(count=64, preprocessing=EVERYTHING),
        VoxelRaster(max_voxels=64, preprocessing=EVERYTHING),
    ):
        assert np.array_equal(raster(both, 0.0), raster(inside, 0.0))


def test_what_is_kept_of_a_dense_scan_covers_it_evenly():
    rng = np.random.default_rng(2)
    dense = rng.uniform(0, 5, (20000, 3))  # nine tenths of the points in one corner
    sparse = rng.uniform(-45, 45, (2000, 3)) * [1, 1, 0.2]
    points = np.concatenate([dense, sparse]).astype(np.float32)
    image = PointsRaster(count=512, preprocessing=EVERYTHING)(points, 0.0).astype(float) * 70
    in_corner = ((image > 0) & (image < 5)).all(axis=1).mean()
    assert in_corner < 0.05
    assert abs((image[:, 0] > 0).mean() - 0.5) < 0.06


def test_voxels_are_those_of_the_points_then_padding():
    points = cloud(300)
    image = VoxelRaster(max_voxels=400, preprocessing=EVERYTHING)(points, -1.0)
    voxels = cylindrical_voxels(points + np.float32([0, 0, 1]))
    assert image.dtype == np.int16
    assert np.array_equal(image[: len(voxels)], voxels)
    assert (image[len(voxels) :] == PADDING).all()
    assert (voxels != PADDING).all()
    assert (voxels[:, 2] < 0).any()  # below the ground, where -1 could not tell padding


def test_steps_of_the_voxels_are_passed_on():
    raster = VoxelRaster(400, degrees=3.0, ring=1.0, height=0.5, preprocessing=EVERYTHING)
    voxels = cylindrical_voxels(cloud(300), 3.0, 1.0, 0.5)
    assert np.array_equal(raster(cloud(300), 0.0)[: len(voxels)], voxels)


def test_too_many_voxels_lose_the_same_share_in_every_direction():
    points = cloud(8000)
    whole = cylindrical_voxels(points)
    kept = VoxelRaster(max_voxels=2000, preprocessing=EVERYTHING)(points, 0.0)
    assert len(whole) > 7000
    assert (kept != PADDING).all()
    assert len(np.unique(kept, axis=0)) == 2000
    assert {tuple(row) for row in kept} <= {tuple(row) for row in whole}
    share = [np.histogram(v[:, 0], bins=12, range=(0, 360))[0] for v in (kept, whole)]
    assert np.allclose(share[0] / share[1], 2000 / len(whole), atol=0.01)


def test_empty_scans():
    nothing = np.zeros((0, 3), np.float32)
    assert not PointsRaster(count=8)(nothing, 0.0).any()
    assert (VoxelRaster(max_voxels=8)(nothing, 0.0) == PADDING).all()
    assert not HeightRaster()(nothing, 0.0).any()


def test_layers_against_a_loop():
    points = scattered(0)
    expected = np.zeros((4, 12, 7), dtype=bool)
    for x, y, z in points.astype(float):
        layer, ring = math.floor((z - 1) / 6 * 4), math.floor(math.hypot(x, y) / 40 * 7)
        sector = math.floor(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * 12)
        if 0 <= layer < 4 and ring < 7:
            expected[layer, sector, ring] = True
    image = polar_layers(points, 40.0, (1.0, 7.0), (4, 12, 7))
    assert expected.any(axis=(1, 2)).all()
    assert (image != expected).sum() <= 1  # float32 rounding at a border


def test_layers_together_are_the_polar_gram():
    points = scattered(1)
    layers = polar_layers(points, 70.0, (0.0, 10.0), (5, 120, 40))
    assert np.array_equal(layers.any(axis=0), polar_gram(points, 70.0, 120, 40))


def test_layers_have_a_floor_and_a_ceiling():
    points = np.array([[10, 1, z] for z in (1.9, 2.0, 2.8, 19.9, 20.0, -3.0)], np.float32)
    per_layer = polar_layers(points).sum(axis=(1, 2))
    assert per_layer.tolist() == [1] + [0] * 18 + [1]
    inside = HeightRaster(preprocessing=EVERYTHING)(points, 0.0)
    assert inside.sum() == 2
    wide = HeightRaster(height=(-20, 20), preprocessing=EVERYTHING)(points, 0.0)
    assert np.flatnonzero(wide.any(axis=(1, 2))).tolist() == [8, 10, 11, 19]  # 2 m each


@pytest.mark.parametrize("steps", [1, 7, 60, -5])
def test_a_turn_of_the_scan_rolls_the_sectors_of_every_layer(steps):
    rng = np.random.default_rng(3)
    azimuth = (rng.integers(0, 120, 400) + 0.5) * 2 * math.pi / 120  # at sector centres
    r = (rng.integers(0, 40, 400) + 0.5) * 70 / 40
    xyz = [r * np.cos(azimuth), r * np.sin(azimuth), rng.uniform(2.1, 19.9, 400)]
    points = np.column_stack(xyz).astype(np.float32)
    raster = HeightRaster()
    turned = raster(turn_points(points, steps * 2 * math.pi / 120), 0.0)
    assert raster(points, 0.0).sum() > 300
    assert np.array_equal(turned, np.roll(raster(points, 0.0), steps, axis=-2))


@pytest.mark.parametrize(
    ("message", "make"),
    [
        (r"raster\.count: 0", lambda: PointsRaster(count=0)),
        (r"raster\.extent: -1", lambda: PointsRaster(extent=-1)),
        (r"preprocessing\.extent: 70 m.*PointsRaster.*80 m", lambda: PointsRaster(extent=80.0)),
        (
            r"preprocessing\.height: .*100.*±70 m",
            lambda: PointsRaster(preprocessing=Preprocessing(height=(-2, 100))),
        ),
        (r"raster\.max_voxels: 2\.5", lambda: VoxelRaster(max_voxels=2.5)),
        (r"voxels\.degrees: 0\.7", lambda: VoxelRaster(degrees=0.7)),
        (r"raster\.ring: 0", lambda: VoxelRaster(ring=0)),
        (r"preprocessing\.extent: 70 m.*VoxelRaster.*80 m", lambda: VoxelRaster(radius=80.0)),
        (r"raster\.layers: 0", lambda: HeightRaster(layers=0)),
        (r"raster\.height: \(20, 2\)", lambda: HeightRaster(height=(20, 2))),
        (r"preprocessing\.extent: 70 m.*HeightRaster.*80 m", lambda: HeightRaster(radius=80.0)),
    ],
)
def test_bad_values_are_named(message, make):
    with pytest.raises(DeepringError, match=message):
        make()

"""Means of the points in voxels: against a loop, sampled as all distances say, and moved."""

import numpy as np
import pytest
import torch

from deepring.core.rigid import moved_points, pose_from, rotation_from_rpy
from deepring.errors import ConfigError, DataError
from deepring.nn.neighbourhoods import farthest_points
from deepring.rasters import IntensityMeansRaster, Preprocessing, VoxelMeansRaster
from deepring.rasters.voxel_means import FULL, NO_POINT
from deepring.testing import walls

ALL = Preprocessing(height=(-2.0, 6.0), clearance=None, extent=70.4)
SMALL = VoxelMeansRaster(300, 20, size=2.0, radius=20.0, preprocessing=ALL)


def points_of(raster, image):
    """x, y, z, intensity (m, 4) of the rows with a point."""
    points, filled = raster.in_metres(torch.from_numpy(image)[None])
    return points[0][filled[0]].numpy()


def by_loop(points, raster):
    """The mean of each voxel's points, by voxel."""
    voxels = {}
    for point in points.astype(np.float64):
        cell = np.floor((point[:3] - raster.corner) / raster.size).astype(int)
        if (cell >= 0).all() and (cell < raster.extent).all():
            voxels.setdefault(tuple(cell.tolist()), []).append(point)
    return np.array([np.mean(voxels[cell], axis=0) for cell in sorted(voxels)])


def in_order(rows):
    return rows[np.lexsort(rows.T[::-1])]


def test_rows_are_the_means_of_a_loop_over_the_points():
    raster = IntensityMeansRaster(2000, 30, 1.5, 30.0, ALL, full_intensity=200.0)
    points = walls(0)
    points = np.column_stack([points, np.arange(len(points)) % 300]).astype(np.float32)
    shares = np.column_stack([points[:, :3], np.minimum(points[:, 3] / 200, 1)])
    means = by_loop(shares[points[:, 2] < 6], raster)
    found = points_of(raster, raster(points, 0.0))
    assert 1000 < len(means) < 2000
    assert np.abs(found - raster_order(means, raster)).max() < 30 / FULL


def raster_order(means, raster):
    """The keypoints by all distances, the others in the order of their voxels."""
    xyz = torch.from_numpy(means[:, :3]).float()
    first = int(xyz[:, :2].norm(dim=1).argmax())
    rest = [first, *(k for k in range(len(means)) if k != first)]  # begins with the farthest
    chosen = np.array(rest)[farthest_points(xyz[rest][None], raster.keypoints)[0].numpy()]
    return np.concatenate([means[chosen], np.delete(means, chosen, axis=0)])


def test_neither_the_order_of_the_points_nor_their_number_in_a_voxel_changes_an_image():
    points = walls(1)
    image = SMALL(points, 0.0)
    assert np.array_equal(SMALL(points[::-1], 0.0), image)
    assert np.array_equal(SMALL(np.repeat(points, 3, axis=0), 0.0), image)


def test_too_many_voxels_are_thinned_evenly_and_too_few_are_followed_by_nothing():
    points = walls(2)
    few = VoxelMeansRaster(100, 10, 2.0, 20.0, ALL)(points, 0.0)
    assert (few[:, 0] != NO_POINT).all()
    all_of_them = {tuple(row) for row in SMALL(points, 0.0).tolist()}
    assert {tuple(row) for row in few.tolist()} <= all_of_them
    lone = SMALL(np.float32([[3, 4, 1]]), 0.0)
    assert points_of(SMALL, lone)[:, :3] == pytest.approx(np.float32([[3, 4, 1]]), abs=1e-3)
    empty = SMALL(np.zeros((0, 3), np.float32), 0.0)
    assert SMALL.is_blank(empty)
    assert not SMALL.is_blank(lone)


def test_points_at_one_place_are_still_different_rows():
    raster = VoxelMeansRaster(8, 8, 1.0, 20.0, ALL)
    below = np.nextafter(np.float32(1), np.float32(0))
    rows = points_of(raster, raster(np.float32([[below, 0.5, 0.5], [1, 0.5, 0.5]]), 0.0))
    assert len(rows) == 2


def test_intensities_are_read_where_they_are_asked_for():
    assert SMALL.columns == ()
    raster = IntensityMeansRaster(full_intensity=255.0)
    assert raster.columns == ("intensity",)
    with pytest.raises(DataError, match=r"expected \(n, 4\): x, y, z, intensity"):
        raster(walls(0), 0.0)


def transform(seed):
    rng = np.random.default_rng(seed)
    angles = [*rng.uniform(-0.05, 0.05, 2), rng.uniform(-3, 3)]
    return pose_from(rotation_from_rpy(*angles), rng.uniform(-1, 1, 3))


def test_moved_images_hold_the_moved_points_that_stay_in_the_box():
    images = torch.from_numpy(np.stack([SMALL(walls(k), 0.0) for k in range(3)]))
    transforms = np.stack([transform(k) for k in range(3)])
    moved = SMALL.moved(images, torch.from_numpy(transforms)).numpy()
    for image, result, by in zip(images.numpy(), moved, transforms, strict=True):
        points = moved_points(points_of(SMALL, image)[:, :3], by)
        inside = (points >= SMALL.corner) & (points < [20, 20, 6])
        expected = points[inside.all(axis=1)]
        assert 0 < len(expected) < len(points)
        # The same order, so that the first rows are still those that were chosen far apart.
        assert np.abs(points_of(SMALL, result)[:, :3] - expected).max() < 2e-3
        assert (result[len(expected) :, 0] == NO_POINT).all()


def test_turned_images_are_those_of_turned_points():
    inner = walls(5)
    inner = inner[np.hypot(inner[:, 0], inner[:, 1]) < 19]
    image = torch.from_numpy(SMALL(inner, 0.0))[None]
    turned = SMALL.turned(image, torch.tensor([90]))
    points = points_of(SMALL, image[0].numpy())
    expected = np.column_stack([-points[:, 1], points[:, 0], points[:, 2:]])
    assert np.abs(points_of(SMALL, turned[0].numpy()) - expected).max() < 2e-3


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"keypoints": 50000}, "max_points: 40000, expected a whole number of at least 50000"),
        ({"size": 0.001}, "raster.size: 0.001 m, expected larger voxels"),
        ({"radius": 100.0}, "preprocessing.extent: 70.4 m"),
        ({"full_intensity": 0.0}, "raster.full_intensity: 0"),
    ],
)
def test_bad_values_are_named(values, message):
    with pytest.raises(ConfigError, match=message):
        IntensityMeansRaster(**values)

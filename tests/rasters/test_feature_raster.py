"""RING++'s images: cells, the largest of each feature, the order of the points, bad values."""

import math

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters import FeatureBevRaster, Preprocessing
from deepring.rasters.bev import bev_occupancy, disc_mask
from deepring.rasters.downsample import voxel_means
from deepring.rasters.local_features import FEATURES, local_features
from helpers.scenes import scattered

EVERYTHING = Preprocessing(height=(-60.0, 60.0), clearance=None)
REACH = FEATURES.index("reach")


def raster(**changes):
    return FeatureBevRaster(**{"preprocessing": EVERYTHING, **changes})


def pole(x, y, height=6.0):
    """Points one above the other, more than a neighbourhood of them."""
    z = np.arange(0, height, 0.1)
    return np.column_stack([np.full_like(z, x), np.full_like(z, y), z]).astype(np.float32)


def test_cells_are_the_occupied_ones_indexed_x_then_y():
    image = raster(extent=70.0, cells=140, voxel=0.01)(pole(10.5, -30.5), 0.0)
    assert image[REACH, 80, 39] > 0
    assert image[REACH, 39, 80] == 0
    points = scattered(0)
    seen = bev_occupancy(voxel_means(points, 0.3).astype(np.float32))
    assert np.array_equal(raster()(points, 0.0)[REACH] > 0, seen)


def test_a_pillar_holds_the_largest_of_each_feature():
    points = scattered(1)
    means = voxel_means(points, 0.3)
    features = local_features(means * [1, 1, 70 / 19])
    expected = np.zeros((6, 120, 120))
    for (x, y, _), row in zip(means, features, strict=True):
        i, j = (math.floor((v + 70) * 120 / 140) for v in (x, y))
        expected[:, i, j] = np.maximum(expected[:, i, j], row)
    expected *= disc_mask(120)
    found = raster()(points, 0.0)
    assert np.allclose(found, expected, rtol=1e-3, atol=1e-6)
    # Mean features would be others.
    cell = np.floor((means[:, :2] + 70) * 120 / 140).astype(int) @ [120, 1]
    sums = np.bincount(cell, weights=features[:, 0], minlength=120 * 120)
    mean = (sums / np.maximum(np.bincount(cell, minlength=120 * 120), 1)).reshape(120, 120)
    assert not np.allclose(found[0], mean * disc_mask(120), rtol=1e-2)


def test_heights_are_stretched_before_neighbours_are_looked_for():
    points = scattered(4)
    plain, stretched = (raster(stretch=s)(points, 0.0)[REACH] for s in (1.0, 70 / 19))
    metres = local_features(voxel_means(points, 0.3))
    assert plain.max() == pytest.approx(metres[:, REACH].max(), rel=1e-3)
    afterwards = plain * np.float16(70 / 19)
    assert stretched.sum() < 0.9 * afterwards.sum()  # what is far up or down is left out


@pytest.mark.parametrize("n", [1, 20, 4000])
def test_the_order_of_the_points_does_not_matter(n):
    points = scattered(2)[:n]
    image = raster()(points, -1.0)
    for seed in range(3):
        shuffled = np.random.default_rng(seed).permutation(points)
        assert np.array_equal(image, raster()(shuffled, -1.0))
    assert np.array_equal(image, raster()(points[::-1], -1.0))


def test_a_quarter_turn_of_the_points_is_a_quarter_turn_of_the_images():
    points = scattered(3)
    turned = np.column_stack([-points[:, 1], points[:, 0], points[:, 2]])
    image = raster()(points, 0.0).astype(float)
    found = raster()(turned, 0.0).astype(float)
    assert np.allclose(found, np.rot90(image, axes=(1, 2)), atol=1e-2)
    assert not np.allclose(found, np.rot90(image, -1, axes=(1, 2)), atol=0.5)
    eighth = raster()(turn_points(points, math.pi / 4), 0.0).astype(float)
    total = image.sum(axis=(1, 2))
    assert np.allclose(eighth.sum(axis=(1, 2)), total, rtol=0.1)


def test_an_empty_scan_and_corners_give_zeros():
    assert not raster()(np.zeros((0, 3), np.float32), 0.0).any()
    assert not raster()(pole(60, 60), 0.0).any()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"neighbours": 2}, r"raster\.neighbours: 2, expected a whole number of at least 3"),
        ({"neighbours": 4.5}, r"raster\.neighbours: 4\.5, expected a whole number"),
        ({"voxel": 0.0}, r"raster\.voxel: 0\.0, expected a number of metres above 0"),
        ({"stretch": -1.0}, r"raster\.stretch: -1\.0, expected a number above 0"),
        ({"stretch": math.inf}, r"raster\.stretch: inf"),
        ({"cells": 0}, r"raster\.cells: 0"),
        ({"extent": 80.0}, r"preprocessing\.extent: 70 m, but the FeatureBevRaster reaches to 80"),
    ],
)
def test_bad_values_are_named(values, complaint):
    with pytest.raises(DeepringError, match=complaint):
        FeatureBevRaster(**values)

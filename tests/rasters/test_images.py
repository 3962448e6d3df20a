"""Images of a scan: axes, disc mask, polar rows, heights, ranges, ground removal."""

import math

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.rasters import RASTERS, Preprocessing, make_raster, raster_settings
from deepring.rasters.bev import bev_occupancy, disc_mask
from deepring.rasters.context import scan_context
from deepring.rasters.polar import polar_gram
from deepring.rasters.range_image import range_image
from deepring.testing import with_columns


def cloud(*rows):
    return np.array(rows, dtype=np.float32)


def test_bev_is_indexed_x_forward_then_y_left():
    image = bev_occupancy(cloud([10.0, -30.0, 1.0]), extent=70, cells=140)
    assert image[80, 40]
    assert not image[40, 80]
    assert image.sum() == 1


def test_bev_against_a_histogram():
    points = np.random.default_rng(0).normal(0, 40, (2000, 3)).astype(np.float32)
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=120, range=[[-70, 70]] * 2)
    assert np.array_equal(bev_occupancy(points, disc=False), counts > 0)
    assert np.array_equal(bev_occupancy(points), (counts > 0) & disc_mask(120))


def test_points_outside_and_not_finite_are_left_out():
    points = cloud([70.0, 0, 0], [0, -70.1, 0], [np.nan, 0, 0], [np.inf, 1, 0], [1e30, 0, 0])
    assert bev_occupancy(points, disc=False).sum() == 0
    assert bev_occupancy(np.zeros((0, 3), np.float32)).sum() == 0


def test_quarter_turn_of_the_points_is_a_quarter_turn_of_the_image():
    points = np.random.default_rng(1).uniform(-60, 60, (500, 3)).astype(np.float32)
    turned = np.column_stack([-points[:, 1], points[:, 0], points[:, 2]])
    assert np.array_equal(bev_occupancy(turned), np.rot90(bev_occupancy(points)))


@pytest.mark.parametrize(
    "image", [scan_context, polar_gram, range_image], ids=["context", "polar", "range"]
)
def test_a_turn_by_k_sectors_rolls_the_rows_by_k(image):
    rng = np.random.default_rng(2)
    azimuth = (rng.integers(0, 60, 300) + 0.5) * 2 * math.pi / 60  # at sector centres
    r = rng.uniform(5, 60, 300)
    points = np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), rng.uniform(0.5, 9, 300)])
    points = points.astype(np.float32)
    turned = turn_points(points, 7 * 2 * math.pi / 60)
    a, b = (image(p, sectors=60).astype(float) for p in (points, turned))
    # float32 rounding may move a point across a ring's edge: all but a few cells agree.
    assert (np.abs(np.roll(a, 7, axis=0) - b) > 1e-4).sum() <= 4
    assert (np.roll(a, -7, axis=0) != b).sum() > 100


def test_scan_context_keeps_the_largest_height():
    points = cloud([10, 0.1, 3.0], [10, 0.1, 7.5], [10, 0.1, -1.0], [0.1, 30, 2.0], [-79.9, 0.1, 5])
    image = scan_context(points, radius=80, sectors=60, rings=20)
    assert image[0, 2] == 7.5
    assert image[14, 7] == 2.0
    assert image[29, 19] == 5.0
    assert image.sum() == pytest.approx(14.5)


def test_range_image_keeps_the_nearest_return():
    points = cloud([20, 0.1, 1.8], [40, 0.1, 1.8])
    image = range_image(points, sectors=4, rows=11, elevation=(-27.5, 27.5), max_range=80)
    assert image[0, 5] == pytest.approx(0.75, abs=1e-4)
    assert (image > 0).sum() == 1


def test_clearance_removes_a_tilted_floor_and_keeps_walls():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-60, 60, (2, 40000))
    floor = np.column_stack([x, y, np.tan(np.radians(3)) * x])
    wall_x, wall_z = rng.uniform(-30, 30, 3000), rng.uniform(0, 6, 3000)
    wall = np.column_stack([wall_x, np.full(3000, 20.0), wall_z + np.tan(np.radians(3)) * wall_x])
    points = np.concatenate([floor, wall]).astype(np.float32)
    kept = Preprocessing()(points, ground_z=0.0)
    on_wall = np.abs(kept[:, 1] - 20.0) < 1e-3
    assert on_wall.sum() > 2400
    assert (~on_wall).sum() < 0.02 * len(floor)
    # A height band alone keeps the uphill floor.
    band = Preprocessing(height=(1.0, 20.0), clearance=None)(points, ground_z=0.0)
    assert (np.abs(band[:, 1] - 20.0) > 1e-3).sum() > 0.2 * len(floor)


def test_heights_are_taken_above_the_ground_of_the_frame():
    points = cloud([5, 0, 0.0], [6, 0, 0.5], [7, 0, 3.0])
    kept = Preprocessing(height=(1.0, 20.0), clearance=None)(points, ground_z=-1.8)
    assert np.allclose(kept[:, 2], [1.8, 2.3, 4.8])


@pytest.mark.parametrize("bad", [{"height": (2, 1)}, {"window": 4}, {"cell": -1.0}, {"extent": 0}])
def test_bad_preprocessing_is_named(bad):
    with pytest.raises(DeepringError, match=next(iter(bad))):
        Preprocessing(**bad)


@pytest.mark.parametrize("kind", RASTERS)
def test_rasters_come_back_from_their_settings(kind):
    raster = RASTERS[kind]()
    assert make_raster(raster_settings(raster)) == raster
    points = np.random.default_rng(4).uniform(-50, 50, (5000, 3)).astype("f4")
    image = raster(with_columns(points, raster.columns), 0.0)
    assert image.shape == raster.shape
    assert image.dtype == raster.dtype
    assert image.any()


def test_unknown_raster_values_are_named():
    with pytest.raises(DeepringError, match=r"raster\.kind"):
        make_raster({"kind": "cubes"})
    with pytest.raises(DeepringError, match="celsl"):
        make_raster({"kind": "bev", "celsl": 3})


def test_clearance_against_scipy():
    from scipy.ndimage import minimum_filter

    points = np.random.default_rng(5).uniform(-69, 69, (20000, 3)).astype(np.float32)
    points[:, 2] = np.random.default_rng(6).gamma(1.0, 2.0, 20000)
    kept = Preprocessing(height=(-1, 50))(points.copy(), 0.0)

    cell = 140 / 120
    half = 121 * cell / 2
    i, j = (np.floor((points[:, axis] + half) / cell).astype(int) for axis in (0, 1))
    lowest = np.full((121, 121), np.inf)
    np.minimum.at(lowest, (i, j), points[:, 2])
    floor = minimum_filter(lowest, size=5, mode="nearest")
    expected = points[points[:, 2] > floor[i, j] + 0.5]
    assert np.array_equal(kept, expected)

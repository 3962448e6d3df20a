"""The quick way to polar cells gives what the exact angle gives, on and beside every border."""

import math

import numpy as np
import pytest

from deepring.rasters import _polar_kernels as kernels


def on_borders(sectors, seed=0):
    """Points on the borders of sectors, a rounding beside them, and anywhere; (n, 3) float32."""
    rng = np.random.default_rng(seed)
    angle = np.arange(sectors) * 2 * math.pi / sectors
    angles = np.concatenate([angle, angle + 1e-7, angle - 1e-7, rng.uniform(-4, 4, 3000)])
    distance = rng.uniform(0.01, 75, len(angles))
    xy = distance[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    axes = [[0, 0], [5, 0], [0, 5], [-5, 0], [0, -5], [-5, -0.0], [3, 3], [-3, 3]]
    xy = np.concatenate([xy, axes])
    return np.column_stack([xy, rng.normal(0, 4, len(xy))]).astype(np.float32)


def test_the_rough_angle_is_off_by_less_than_is_said():
    points = on_borders(120)
    rough = np.array([kernels.rough_angle(y, x) for x, y, _ in points])
    exact = np.arctan2(points[:, 1].astype(float), points[:, 0].astype(float))
    # At half a turn -π and π are one.
    apart = np.abs((rough - exact + math.pi) % (2 * math.pi) - math.pi)
    assert apart.max() < kernels._OFF / 2


@pytest.mark.parametrize("sectors", [4, 60, 120, 1023])
def test_polar_cells_are_those_of_the_exact_angle(sectors):
    points = on_borders(sectors)
    expected = np.full((sectors, 30), -np.inf, dtype=np.float32)
    for x, y, z in points:
        ring = int(np.sqrt(x * x + y * y) / 70.0 * 30)
        if ring < 30:
            s = kernels.exact_sector(y, x, sectors)
            expected[s, ring] = max(expected[s, ring], z)
    found = np.full_like(expected, -np.inf)
    kernels.polar_highest(points.ravel(), 70.0, found)
    assert np.array_equal(found, expected)
    # The polynomial alone would put some of them elsewhere.
    xs, ys = (np.ascontiguousarray(points[:, axis]) for axis in (0, 1))
    sector, sure = kernels.rough_sectors(xs, ys, sectors)
    exact = np.array([kernels.exact_sector(y, x, sectors) for x, y, _ in points])
    assert (sector[sure] == exact[sure]).all()
    assert (sector[~sure] != exact[~sure]).any()


def test_range_images_are_those_of_the_exact_angles():
    points = on_borders(120, seed=1)
    low, high, rows = math.radians(-25), math.radians(30), 32
    expected = np.full((120, rows), 80.0, dtype=np.float32)
    for x, y, z in points:
        flat = np.float32(np.sqrt(x * x + y * y))
        height = float(z) - 1.8
        row = math.floor((math.atan2(height, flat) - low) / (high - low) * rows)
        if 0 <= row < rows:
            s = kernels.exact_sector(y, x, 120)
            reach = np.float32(math.sqrt(float(flat) * float(flat) + height * height))
            expected[s, row] = min(expected[s, row], reach)
    found = np.full_like(expected, 80.0)
    kernels.nearest_return(points.ravel(), 1.8, low, high, found)
    assert np.allclose(found, expected, atol=1e-4)

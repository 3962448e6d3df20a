"""Ranges by class and by height in each direction, against plain loops."""

import math

import numpy as np
import pytest
import torch

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DataError
from deepring.rasters import HeightRangesRaster, Preprocessing, SemanticRangesRaster
from deepring.rasters.channel_ranges import CHANNELS
from deepring.testing import walls

#: SemanticKITTI's label of each channel.
LABELS = (10, 40, 44, 48, 49, 50, 51, 70, 71, 72, 80, 81)


def labelled(seed, count=3000):
    rng = np.random.default_rng(seed)
    labels = rng.choice([*LABELS, 0, 30, 252], count)
    return np.column_stack([rng.normal(0, 20, (count, 3)), labels]).astype(np.float32)


def by_loop(points, channel_of, channels, farthest, radius, sectors):
    image = np.zeros((sectors, channels))
    for x, y, z, value in points.astype(np.float64):
        channel, away = channel_of(z, value), math.hypot(x, y) / radius
        if channel is None or away >= 1:
            continue
        sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * sectors) % sectors
        held = image[sector, channel]
        better = away > held if channel in farthest else away < held
        if held == 0 or better:
            image[sector, channel] = away
    return image


@pytest.mark.parametrize("seed", range(3))
def test_classes_are_those_of_a_loop_over_the_points(seed):
    points = labelled(seed)
    channels = {**{label: k for k, label in enumerate(LABELS)}, 252: 0}  # a moving car is a car
    expected = by_loop(points, lambda _, value: channels.get(int(value)), 12, {1}, 50.0, 72)
    found = SemanticRangesRaster(sectors=72)(points, 0.0)
    assert found.dtype == np.float16
    assert np.allclose(found, expected, atol=5e-4)
    assert (found == 0).any()


def test_bands_of_height_are_those_of_a_loop_over_the_points():
    points = labelled(4)
    raw = Preprocessing(height=(-99, 99), clearance=None)
    raster = HeightRangesRaster(sectors=72, bands=5, height=(-1.0, 9.0), preprocessing=raw)

    def band(z, _):
        return int((z + 1.0) // 2.0) if -1.0 <= z < 9.0 else None

    expected = by_loop(points, band, 5, (), 50.0, 72)
    assert np.allclose(raster(points, 0.0), expected, atol=5e-4)


def test_of_the_road_the_farthest_counts_of_all_else_the_nearest():
    for k, label in enumerate(LABELS):
        points = np.array([[20, 0.01, 0, label], [5, 0.01, 0, label], [60, 0.01, 0, label]])
        image = SemanticRangesRaster()(points, 0.0)
        assert np.argwhere(image).tolist() == [[0, k]]
        assert image[0, k] == pytest.approx(0.4 if CHANNELS[k] == "road" else 0.1, abs=1e-3)


@pytest.mark.parametrize("kind", [SemanticRangesRaster, HeightRangesRaster])
def test_a_turn_rolls_the_sectors(kind):
    points = np.column_stack([walls(4), np.resize(LABELS, len(walls(4)))])
    turned = points.copy()
    turned[:, :3] = turn_points(points[:, :3].astype(np.float32), math.radians(35))
    raster = kind()
    before, after = (torch.from_numpy(raster(p, 0.0))[None] for p in (points, turned))
    right = (raster.turned(before, torch.tensor([35])) - after).abs() < 2e-3
    wrong = (raster.turned(before, torch.tensor([-35])) - after).abs() < 2e-3
    assert right.float().mean() > 0.995  # points on a border may fall to either side
    assert wrong.float().mean() < 0.97


def test_what_means_nothing_is_refused():
    with pytest.raises(DataError, match=r"points: a label 70000, expected whole numbers"):
        SemanticRangesRaster()(np.array([[5, 0, 0, 70_000]]), 0.0)
    for values, complaint in (
        ({"bands": 0}, r"raster\.bands: 0"),
        ({"bands": 128}, r"raster\.bands: 128"),
        ({"height": (3.0, 1.0)}, r"raster\.height"),
        ({"radius": 90.0}, r"preprocessing\.extent: 70 m, but the HeightRangesRaster"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            HeightRangesRaster(**values)
    with pytest.raises(ConfigError, match=r"preprocessing\.extent: 50 m"):
        SemanticRangesRaster(radius=60.0)

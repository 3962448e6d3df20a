"""LocNet: histograms of rings against a loop over points; the network's shapes and invariance."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError
from deepring.methods.locnet import LocNet, LocNetSettings
from deepring.rasters import RingHistogramRaster, raster_settings
from deepring.rasters.ring_histogram import ring_histograms
from deepring.testing import walls


def small(seed=0):
    torch.manual_seed(seed)
    raster = raster_settings(RingHistogramRaster(rows=16, buckets=20))
    return LocNet(LocNetSettings(raster, channels=(4, 6), dimension=5)).eval()


def by_loop(points, rows, buckets, span, feature, elevation, viewpoint):
    counts = np.zeros((rows, buckets))
    low, high = span
    rings = [[] for _ in range(rows)]
    for x, y, z in points.astype(np.float64):
        angle = math.degrees(math.atan2(z - viewpoint, math.hypot(x, y)))
        row = math.floor((angle - elevation[0]) / (elevation[1] - elevation[0]) * rows)
        if 0 <= row < rows:
            rings[row].append((math.atan2(y, x), math.hypot(x, y), x, y))
    for row, ring in enumerate(rings):
        ring.sort()
        for k, (_, across, x, y) in enumerate(ring):
            *_, nx, ny = ring[(k + 1) % len(ring)]
            value = across if feature == "range" else math.hypot(nx - x, ny - y)
            if low < value < high:
                counts[row, int((value - low) / (high - low) * buckets)] += 1
    return counts / np.maximum(1, counts.sum(axis=1, keepdims=True))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(st.sampled_from(["range", "difference"]), st.integers(1, 20), st.integers(0, 99))
def test_histograms_are_those_of_a_loop_over_the_points(feature, rows, seed):
    points = np.random.default_rng(seed).normal(0, 20, (300, 3)).astype(np.float32)
    span = (2.0, 30.0) if feature == "range" else (0.5, 15.0)
    values = (rows, 14, span, feature, (-30.0, 40.0), 1.7)
    assert np.allclose(ring_histograms(points, *values), by_loop(points, *values), atol=1e-6)


def test_a_ring_of_four_points():
    ranges = [3.2, 3.7, 10.5, 80.9, 0.9, 1.0, 81.0]  # the last three are out of the span
    points = np.array([[r, 0, 0] for r in ranges], dtype=np.float32)
    image = ring_histograms(points, rows=1, elevation=(-10.0, 10.0))[0]
    assert {int(k): float(image[k]) for k in np.flatnonzero(image)} == {2: 0.5, 9: 0.25, 79: 0.25}
    # A value on an inner border is in the upper bucket.
    border = ring_histograms(np.float32([[0, 4.0, 0]]), rows=1, elevation=(-10.0, 10.0))
    assert np.flatnonzero(border).tolist() == [3]


def test_differences_are_between_neighbours_in_azimuth_and_the_last_has_the_first():
    azimuth = np.radians([170.0, -170.0, 90.0])  # out of order
    points = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth]) * 10
    apart = 20 * np.sin(np.radians([10.0, 40.0, 50.0]))  # half of 20, 80 and 260 = 100 degrees
    values = (1, 200, (0.0, 20.0), "difference", (-10.0, 10.0), 0.0)
    image = ring_histograms(points.astype(np.float32), *values)[0]
    assert np.flatnonzero(image).tolist() == sorted(int(d * 10) for d in apart)


@pytest.mark.parametrize("feature", ["range", "difference"])
def test_neither_a_turn_nor_the_order_of_the_points_changes_an_image(feature):
    span = (1.0, 81.0) if feature == "range" else (0.01, 5.0)
    raster = RingHistogramRaster(rows=16, span=span, feature=feature)
    points = walls(3)
    image = raster(points, 0.0)
    sums = image.astype(float).sum(axis=1)
    assert ((np.abs(sums - 1) < 0.01) | (sums == 0)).all()
    assert 0 < (sums > 0).sum() < 16
    shuffled = np.random.default_rng(0).permutation(points)
    assert np.array_equal(raster(shuffled, 0.0), image)
    # A point on a border may fall to either side.
    turned = raster(turn_points(points, 1.234), 0.0)
    assert np.abs(turned.astype(float) - image).sum() < 0.05 * sums.sum()
    assert np.abs(raster(walls(4), 0.0).astype(float) - image).sum() > 0.5 * sums.sum()
    kept = torch.from_numpy(image)[None]
    assert torch.equal(raster.turned(kept, torch.tensor([90])), kept)


def test_rings_are_seen_from_the_viewpoint():
    points = np.float32([[10, 0, 1.73], [10, 0, 0]])
    image = RingHistogramRaster(rows=28)(points, 0.0)
    assert np.flatnonzero(image.any(axis=1)).tolist() == [15, 25]  # 9.8 degrees down, and level


def test_it_has_the_published_shapes():
    net = LocNet()
    assert net.raster == RingHistogramRaster()
    assert sum(p.numel() for p in net.parameters()) == 1_231_450
    shapes, x = [], torch.zeros(1, 1, 64, 80)
    for layer in net.layers:
        x = layer(x)
        shapes.append(tuple(x.shape[1:]))
    assert shapes[0] == (50, 60, 76)
    assert shapes[2] == (50, 30, 38)
    assert shapes[3] == (100, 26, 34)
    assert shapes[5:7] == [(100, 13, 17), (22_100,)]
    assert shapes[-1] == net.descriptor_shape == (50,)


def test_descriptors_are_not_negative_have_no_norm_and_no_turn_changes_them():
    net = small()
    scans = [walls(k) for k in range(4)]
    images = torch.from_numpy(np.stack([net.raster(p, 0.0) for p in scans]))
    descriptors = net.describe(images)
    assert (descriptors >= 0).all()
    assert (descriptors == 0).any()  # ReLU comes last
    assert not torch.allclose(descriptors.norm(dim=1), torch.ones(4), atol=0.1)
    turned = [turn_points(p, 2.0) for p in scans]
    images = torch.from_numpy(np.stack([net.raster(p, 0.0) for p in turned]))
    score, turn = net.compare(net.describe(images), descriptors)
    assert turn is None
    assert torch.equal(score.argmax(dim=1), torch.arange(4))
    apart = (net.describe(images)[0] - descriptors[1]).norm()
    assert score[0, 1].item() == pytest.approx(-apart.item(), abs=1e-6)


def test_settings_that_mean_nothing_are_refused():
    for values, complaint in (
        ({"feature": "height"}, r"raster\.feature: 'height'"),
        ({"rows": 0}, r"raster\.rows: 0"),
        ({"span": (5.0, 2.0)}, r"raster\.span"),
        ({"elevation": (-100.0, 2.0)}, r"raster\.elevation: \[-100\.0, 2\.0\]"),
        ({"span": (1.0, 99.0)}, r"preprocessing\.extent: 81 m, but the RingHistogramRaster"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            RingHistogramRaster(**values)
    low = raster_settings(RingHistogramRaster(rows=15))
    for values, complaint in (
        ({"raster": low}, r"locnet: a raster of 15 x 80, expected at least 16 rows"),
        ({"channels": (4,)}, r"locnet\.channels: \[4\], expected two numbers"),
        ({"dimension": 0}, r"locnet\.dimension: 0"),
    ):
        with pytest.raises(ConfigError, match=complaint):
            LocNet(LocNetSettings(**values))

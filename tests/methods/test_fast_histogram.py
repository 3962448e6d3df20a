"""Fast Histogram: counted ranges, and a Wasserstein distance against moving points one by one."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError
from deepring.methods.fast_histogram import FastHistogram
from deepring.methods.method import index_of
from deepring.rasters import HistogramRaster, Preprocessing
from deepring.rasters.histogram import range_histogram
from deepring.testing import walls

RAW = Preprocessing(height=(-5.0, 100.0), clearance=None, extent=80.0)


def at(ranges, seed=0):
    """Points at these ranges from the sensor, in random directions."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(len(ranges), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return (direction * np.asarray(ranges)[:, None]).astype(np.float32)


def distance(one, other, buckets=10, span=(0.0, 10.0)):
    """W of two sets of ranges."""
    method = FastHistogram(HistogramRaster(buckets, span, 0.0, RAW))
    shares = [torch.from_numpy(range_histogram(at(r), buckets, span))[None] for r in (one, other)]
    query, entry = (method.describe(share) for share in shares)
    return -method.compare(query, entry).score.item()


def test_a_third_of_the_points_moves_four_buckets():
    found = distance([1.5, 2.5, 9.5], [1.5, 6.5, 9.5])
    assert found == pytest.approx(4 / 3 / 10, abs=1e-6)
    # With the magnitude inside the sum, as ports have it, the same pair is 0.4 apart.
    assert found != pytest.approx(0.4, abs=0.1)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 12), st.integers(1, 9), st.integers(0, 999))
def test_distance_against_moving_the_points_in_order(buckets, count, seed):
    rng = np.random.default_rng(seed)
    one, other = rng.integers(buckets, size=(2, count))
    # The cheapest way to move as many points along a line keeps their order.
    expected = np.abs(np.sort(one) - np.sort(other)).mean() / buckets
    found = distance(one + 0.5, other + 0.5, buckets, (0.0, float(buckets)))
    assert found == pytest.approx(expected, abs=1e-5)


def test_it_is_a_metric():
    method = FastHistogram()
    shares = np.stack([method.raster(walls(k), 0.0) for k in range(6)])
    apart = -method.compare(method.describe(shares), method.describe(shares)).score
    assert torch.equal(apart.diagonal(), torch.zeros(6))
    assert (apart + torch.eye(6) > 1e-3).all()
    assert torch.allclose(apart, apart.T, atol=1e-7)
    detour = apart[:, :, None] + apart[None]
    assert (detour.min(dim=1).values >= apart - 1e-6).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 30), st.integers(0, 999))
def test_buckets_against_a_loop(buckets, seed):
    low, high, height = 2.0, 40.0, 1.7
    points = walls(seed)[:200]
    counts, total = np.zeros(buckets), 0
    for x, y, z in points.astype(np.float64):
        away = (x * x + y * y + (z - height) ** 2) ** 0.5
        if low <= away < high:
            counts[int((away - low) // ((high - low) / buckets))] += 1
            total += 1
    found = range_histogram(points, buckets, (low, high), height)
    assert np.allclose(found, counts / max(1, total), atol=1e-6)


def test_points_out_of_the_span_do_not_count():
    near = range_histogram(at([1.5, 2.5]), 10, (0.0, 10.0))
    assert near.sum() == 1
    assert np.array_equal(near, range_histogram(at([1.5, 2.5, 10.5, 70.0]), 10, (0.0, 10.0)))
    # The first edge belongs to its bucket, the last one to none.
    on_edges = np.array([[2, 0, 0], [4, 0, 0], [6, 0, 0]], dtype=np.float32)
    assert range_histogram(on_edges, 2, (2.0, 6.0)).tolist() == [0.5, 0.5]


def test_the_range_is_measured_in_space_from_the_sensor():
    points = np.array([[3.0, 0.0, 1.73 + 4.0]], dtype=np.float32)
    assert HistogramRaster(10, (0.0, 10.0))(points, 0.0).argmax() == 5  # not 3, in the plane
    # The sensor's frame has the sensor at the origin, and the ground below it.
    assert HistogramRaster(10, (0.0, 10.0))(points - [0, 0, 1.73], -1.73).argmax() == 5


def test_turns_mirrors_and_doubled_points_change_nothing():
    rng = np.random.default_rng(1)
    points = at(0.8 * (rng.integers(100, size=500) + 0.5))
    whole = range_histogram(points)
    for changed in (
        turn_points(points, 1.234),
        points * np.float32([1, -1, 1]),
        points[::-1],
        np.concatenate([points, points]),
    ):
        assert np.allclose(range_histogram(changed), whole, atol=1e-7)
    raster = HistogramRaster()
    images = torch.from_numpy(whole)[None]
    assert torch.equal(raster.turned(images, torch.tensor([77])), images)


def test_no_points_are_a_blank_raster_and_still_compared():
    raster = HistogramRaster()
    blank = raster(np.zeros((0, 3)), 0.0)
    assert raster.is_blank(blank)
    assert not blank.any()
    method = FastHistogram(raster)
    both = method.describe(np.stack([blank, raster(walls(0), 0.0)]))
    score = method.compare(both, both).score
    assert score[0, 0] == 0
    assert score[0, 1] < 0


def test_the_index_finds_what_compare_finds():
    method = FastHistogram()
    places = method.describe(np.stack([method.raster(walls(k), 0.0) for k in range(12)]))
    index = index_of(method)
    index.add(places[:5])
    index.add(places[5:])
    hits = index.search(places[:3], 4)
    assert hits.place[:, 0].tolist() == [0, 1, 2]
    assert hits.turn is None
    best = method.compare(places[:3], places).score.topk(4).values
    assert torch.allclose(hits.score, best)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"buckets": 0}, r"raster\.buckets: 0"),
        ({"span": (5.0, 2.0)}, r"raster\.span"),
        ({"span": (-1.0, 20.0)}, r"raster\.span: -1"),
        ({"span": (0.0, 90.0)}, r"preprocessing\.extent: 80 m, but .* reaches to 90 m"),
        ({"viewpoint": float("nan")}, r"raster\.viewpoint"),
    ],
)
def test_bad_settings_are_named(values, complaint):
    with pytest.raises(ConfigError, match=complaint):
        HistogramRaster(**values)

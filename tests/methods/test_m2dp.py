"""M2DP: worked values, projections against NumPy's histograms, and which turns it survives."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError
from deepring.methods.m2dp import M2dp
from deepring.methods.method import index_of
from deepring.rasters import M2dpRaster
from deepring.rasters.m2dp import in_own_axes, m2dp, m2dp_planes, plane_shares
from deepring.search.compare_index import CompareIndex
from deepring.search.vector_index import VectorIndex
from deepring.testing import walls

FIVE = np.array([(6, 1, 0.5), (-4, 2, 1), (-3, -2.5, 0.2), (2, -1, -0.7), (-1, 0.5, -1)])
PLANES = m2dp_planes()


def described(points, signs=1):
    """Descriptors (1, signs, 192) of a scan (n, 3)."""
    return torch.from_numpy(M2dpRaster(signs=signs)(points, 0.0))[None]


def apart(one, other, signs=1):
    """The distance of a query from an entry, scans (n, 3)."""
    method = M2dp(M2dpRaster(signs=signs))
    return -method.compare(described(one, signs), described(other, signs)).score.item()


def exact(points):
    return m2dp(in_own_axes(points), PLANES)


def turned(points, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def test_five_points_worked_by_hand():
    own = in_own_axes(FIVE)
    assert own[0] == pytest.approx([6.02818, 0.80511, 0.51264], abs=1e-5)
    shares = plane_shares(own, PLANES)
    assert np.flatnonzero(shares[15]).tolist() == [63, 70, 97, 110, 120]
    assert np.flatnonzero(shares[0]).tolist() == [50, 71, 95, 111, 120]
    assert shares[0].max() == pytest.approx(0.2)
    values = np.linalg.svd(shares)[1][:3]
    assert values == pytest.approx([2.21787, 1.21305, 0.99520], abs=1e-5)
    descriptor = m2dp(own, PLANES)
    assert descriptor[:4] == pytest.approx([0.0661, 0.0661, 0.0661, 0.07109], abs=1e-5)
    assert descriptor[64:].argmax() == 120
    assert descriptor[64:].max() == pytest.approx(0.51929, abs=1e-5)
    assert (descriptor[64:] > 1e-9).sum() == 44
    assert np.linalg.norm(descriptor) == pytest.approx(math.sqrt(2))


@pytest.mark.parametrize(
    ("degrees", "distance"), [(30, 0), (90, 1.0554), (120, 1.0554), (180, 1.4298), (270, 1.41003)]
)
def test_a_turn_that_negates_an_axis_makes_another_place(degrees, distance):
    found = np.linalg.norm(exact(turned(FIVE, degrees)) - exact(FIVE))
    assert found == pytest.approx(distance, abs=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.integers(3, 400), st.integers(1, 9), st.integers(1, 20), st.integers(0, 999))
def test_shares_against_histograms_of_each_plane(count, radial, angular, seed):
    rng = np.random.default_rng(seed)
    own = rng.normal(size=(count, 3)) * [20, 9, 3]
    radius = np.linalg.norm(own, axis=1).max()
    edges = np.linspace(0, np.sqrt(radius), radial + 1) ** 2
    edges[-1] += 0.001
    planes = []
    for azimuth in np.linspace(-np.pi / 2, np.pi / 2, 4):
        for elevation in np.linspace(0, np.pi / 2, 5):
            normal = np.array(
                [
                    np.cos(elevation) * np.cos(azimuth),
                    np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation),
                ]
            )
            x = np.array([1.0, 0, 0]) - normal[0] * normal
            y = np.cross(normal, x)
            angle, length = np.arctan2(own @ y, own @ x), np.hypot(own @ x, own @ y)
            sectors = np.linspace(-np.pi, np.pi, angular + 1)
            counts, _, _ = np.histogram2d(length, angle, [edges, sectors])
            planes.append(counts.ravel() / count)
    found = plane_shares(own, m2dp_planes(4, 5), radial, angular)
    assert np.abs(found - np.array(planes)).max() < 1e-12
    assert found.sum(axis=1) == pytest.approx(np.ones(20))


def test_the_last_sector_is_closed_and_no_point_is_lost():
    own = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    from_above = plane_shares(own, PLANES)[15].reshape(8, 16)
    assert from_above.sum() == pytest.approx(1)
    assert from_above[7, 15] == pytest.approx(1 / 3)  # the angle π; ports lose it


def test_planes_that_coincide():
    shares = plane_shares(in_own_axes(walls(0)), PLANES)
    for plane in (31, 47, 63):
        assert np.abs(shares[plane] - shares[15]).sum() < 0.01
    assert len(PLANES.along) == 64
    lengths = [np.linalg.norm(axes, axis=1) for axes in PLANES]
    assert lengths[0] == pytest.approx(lengths[1])
    assert lengths[0].min() < 0.6  # they are not normalised
    assert (PLANES.along * PLANES.across).sum(axis=1) == pytest.approx(np.zeros(64))


def test_moved_shuffled_and_doubled_scans_are_the_same():
    points = walls(1)
    rng = np.random.default_rng(0)
    base = exact(points.astype(np.float64))
    for same in (
        points + np.array([100.0, -50.0, 3.0]),
        rng.permutation(points),
        np.concatenate([points, points]),
    ):
        assert np.linalg.norm(exact(same.astype(np.float64)) - base) < 0.01
    assert np.linalg.norm(exact(walls(2).astype(np.float64)) - base) > 0.3


def test_an_axis_points_where_its_largest_coordinate_is_positive():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(500, 3)) * [9, 4, 1]
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    scan = points @ rotation
    axes = np.linalg.lstsq(scan - scan.mean(axis=0), in_own_axes(scan), rcond=None)[0]
    assert np.allclose(axes.T @ axes, np.eye(3), atol=1e-9)
    assert (axes[np.abs(axes).argmax(axis=0), range(3)] > 0).all()
    variance = in_own_axes(scan).var(axis=0)
    assert variance[0] > variance[1] > variance[2]


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.array([[1.0, 2, 3], [4, 5, 6]]),
        np.ones((50, 3)),
        np.arange(50)[:, None] * np.array([1.0, 0, 0]),
        np.concatenate([np.eye(3), -np.eye(3)]),
    ],
    ids=["none", "two", "one place", "a line", "a ball"],
)
def test_what_has_no_axes_of_its_own_is_blank(points):
    raster = M2dpRaster()
    found = raster(points, 0.0)
    assert found.shape == (1, 192)
    assert not found.any()
    assert raster.is_blank(found)


def test_a_place_the_other_way_round_needs_four_signs():
    scan = walls(3)
    around = turn_points(scan, math.pi)
    assert apart(around, scan) > 0.2
    for angle in (0.3, math.pi / 2, math.pi, -2.0):
        assert apart(turn_points(scan, angle), scan, signs=4) < 0.05
    assert apart(walls(5), scan, signs=4) > 0.2


def test_four_signs_take_the_nearest_of_the_entry():
    scan = walls(6)
    own = in_own_axes(scan)
    query = in_own_axes(walls(7))
    distances = [
        np.linalg.norm(m2dp(query, PLANES) - m2dp(own * np.array([x, y, 1]), PLANES))
        for x in (1, -1)
        for y in (1, -1)
    ]
    assert apart(walls(7), scan, signs=4) == pytest.approx(min(distances), abs=1e-4)
    assert apart(walls(7), scan) == pytest.approx(distances[0], abs=1e-4)


@pytest.mark.parametrize(("signs", "kind"), [(1, VectorIndex), (4, CompareIndex)])
def test_the_index_finds_what_compare_finds(signs, kind):
    method = M2dp(M2dpRaster(signs=signs))
    places = torch.cat([described(walls(k), signs) for k in range(9)])
    index = index_of(method)
    assert type(index) is kind
    index.add(places)
    hits = index.search(places[:3], 4)
    assert hits.place[:, 0].tolist() == [0, 1, 2]
    best = method.compare(places[:3], places).score.topk(4).values
    assert torch.allclose(hits.score, best, atol=2e-5)
    assert hits.turn is None


def test_averaging_in_a_grid_is_asked_for():
    scan = np.concatenate([walls(8), walls(8) + np.float32(0.001)])
    assert not np.array_equal(M2dpRaster(grid=0.5)(scan, 0.0), M2dpRaster()(scan, 0.0))
    assert not M2dpRaster(grid=0.5)(np.zeros((0, 3)), 0.0).any()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"signs": 2}, r"raster\.signs: 2, expected 1 or 4"),
        ({"azimuths": 0}, r"raster\.azimuths: 0"),
        ({"grid": -0.1}, r"raster\.grid"),
    ],
)
def test_bad_settings_are_named(values, complaint):
    with pytest.raises(ConfigError, match=complaint):
        M2dpRaster(**values)

"""LPD-Net's features: known values, a loop over sizes, scaling, turns, and the raster of them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DataError
from deepring.rasters import PointFeaturesRaster, PointsRaster, Preprocessing
from deepring.rasters._neighbourhood_kernels import dimensionality_entropy, eigen
from deepring.rasters.adaptive_features import (
    ADAPTIVE_FEATURES,
    SIZES,
    adaptive_features,
    chosen_neighbourhoods,
    scaled,
)

WHOLE = Preprocessing(height=(-60.0, 60.0), clearance=None)


def cloud(n, seed=0, spread=(20.0, 20.0, 4.0)):
    return np.random.default_rng(seed).normal(0, spread, (n, 3))


def with_eigenvalues(*values):
    """Six points around the origin whose covariance over k - 1 has these eigenvalues."""
    axes = np.diag(np.sqrt(np.array(values) * 5 / 2))
    return np.concatenate([axes, -axes])


def features_of(points):
    """Of points that are all each other's neighbours: the same for each, by name."""
    rows = adaptive_features(points, [len(points)])
    assert np.allclose(rows, rows[0])
    return dict(zip(ADAPTIVE_FEATURES, rows[0].tolist(), strict=True))


def test_the_worked_example_of_eigenvalues_3_2_1():
    found = features_of(with_eigenvalues(3, 2, 1))
    assert found["curvature"] == pytest.approx(0.16667, abs=1e-5)
    assert found["omnivariance"] == pytest.approx(0.30285, abs=1e-5)
    assert found["linearity"] == pytest.approx(0.33333, abs=1e-5)
    assert found["entropy"] == pytest.approx(1.01140, abs=1e-5)
    # 0.79577 is that of k = 20: density is proportional to k.
    assert found["density"] * 20 / 6 == pytest.approx(0.79577, abs=1e-5)
    assert found["scatter"] == pytest.approx(5)
    assert found["flatness"] == pytest.approx(2 / 3)  # not its inverse
    assert found["reach"] == pytest.approx(2 * math.sqrt(2.5))
    assert found["variance"] == pytest.approx(5 / 6)  # over k, the covariance over k - 1
    assert found["upright"] == pytest.approx(1)
    assert dimensionality_entropy(np.array([3.0, 2.0, 1.0])) == pytest.approx(1.09861, abs=1e-5)


@pytest.mark.parametrize(("order", "upright"), [((3, 2, 1), 1), ((1, 3, 2), 0), ((3, 1, 2), 0)])
def test_upright_is_of_the_normal(order, upright):
    assert features_of(with_eigenvalues(*order))["upright"] == pytest.approx(upright)


def test_upright_is_the_normal_s_z_and_not_the_matrix_s_transposed():
    slope = math.radians(30)
    points = cloud(40, spread=(5, 3, 0))
    tilted = points @ [[math.cos(slope), 0, math.sin(slope)], [0, 1, 0], [0, 0, 0]]
    found = adaptive_features(tilted, [40])[:, -1]
    assert np.allclose(found, math.cos(slope))


def test_a_plane_is_infinitely_dense_and_a_line_chooses_the_least_size():
    plane = features_of(cloud(30, spread=(5, 3, 0)))
    assert (plane["curvature"], plane["omnivariance"]) == (0, 0)
    assert math.isinf(plane["density"])
    line = np.outer(np.arange(120.0), [1.0, 0.3, 0.2])
    moments, _ = chosen_neighbourhoods(line)
    assert (moments[:, 8] == 20).all()
    assert (adaptive_features(line)[:, 2] == 1).all()


def test_the_size_and_the_features_against_a_loop():
    points = cloud(300)
    found, (moments, _) = adaptive_features(points), chosen_neighbourhoods(points)
    sizes = set()
    for k in range(0, 300, 7):
        order = np.argsort(np.linalg.norm(points - points[k], axis=1))
        size, near, values, normal = min(
            (neighbourhood(points[order[:size]]) for size in SIZES),
            key=lambda one: entropy((one[2] - [*one[2][1:], 0]) / one[2][0]),
        )
        assert size == moments[k, 8]
        sizes.add(size)
        flat = np.linalg.eigvalsh(np.cov(near[:, :2].T))
        share, z = values / values.sum(), near[:, 2]
        expected = [
            *(share[2], np.prod(values / values.sum()) ** (1 / 3)),
            *((values[0] - values[1]) / values[0], entropy(share)),
            *(3 * size / (4 * math.pi * np.prod(values)), flat.sum(), flat[0] / flat[1]),
            *(z.max() - z.min(), z.var(), abs(normal[2])),
        ]
        assert np.allclose(found[k], expected, rtol=1e-8)
    assert len(sizes) > 4  # points differ in what they choose


def neighbourhood(near):
    values, vectors = np.linalg.eigh(np.cov(near.T))
    return len(near), near, values[::-1], vectors[:, 0]


def entropy(share):
    return -(share * np.log(share)).sum()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.integers(0, 10**6), st.sampled_from([(1, 1, 1), (1, 1, 1e-3), (1, 1e-6, 1e-6), (5, 5, 0)])
)
def test_eigenvalues_against_lapack(seed, scale):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    matrix = turn * np.array(scale) @ turn.T
    values, vectors = np.empty(3), np.empty((3, 3))
    eigen(matrix.copy(), values, vectors)
    assert np.allclose(values, np.sort(scale)[::-1], atol=1e-9)
    assert np.allclose(vectors.T @ vectors, np.eye(3))
    assert np.allclose(vectors * values @ vectors.T, matrix, atol=1e-8)


def test_turns_about_the_vertical_translations_and_the_unit_change_no_scaled_feature():
    points = cloud(400).astype(np.float32)
    expected = scaled(adaptive_features(points))
    for same in (turn_points(points, 0.7), points + np.float32([30, -20, 4]), points / 70):
        assert np.allclose(scaled(adaptive_features(same)), expected, atol=1e-5)
    lying = points[:, [2, 0, 1]]
    assert not np.allclose(scaled(adaptive_features(lying)), expected, atol=0.1)


def test_each_feature_but_the_last_fills_0_to_1_and_infinite_ones_are_1():
    values = np.tile([[2.0], [math.inf], [6.0], [4.0]], 10)
    values[:, -1] = 0.3
    values[:, 0] = 5.0  # the same everywhere
    found = scaled(values)
    assert found[:, 1].tolist() == [0, 1, 1, 0.5]
    assert not found[:, 0].any()
    assert (found[:, -1] == 0.3).all()
    assert scaled(np.zeros((0, 10))).shape == (0, 10)


@pytest.mark.parametrize("n", [0, 1, 2, 19, 20, 21])
def test_few_points_have_finite_features_once_scaled(n):
    found = scaled(adaptive_features(cloud(n)))
    assert found.shape == (n, 10)
    assert np.isfinite(found).all()


def test_points_that_coincide_are_no_neighbourhood():
    found = adaptive_features(np.ones((40, 3)))
    assert not np.delete(found, 4, axis=1).any()


@pytest.mark.parametrize("n", [5, 200, 900])
def test_the_raster_holds_the_points_and_their_features_in_any_order(n):
    points = cloud(n, spread=(15.0, 15.0, 3.0)).astype(np.float32)
    raster = PointFeaturesRaster(count=256, preprocessing=WHOLE)
    image = raster(points, -1.0)
    assert (image.shape, image.dtype) == ((256, 13), np.float16)
    plain = PointsRaster(count=256, preprocessing=WHOLE)(points, -1.0)
    assert np.array_equal(image[:, :3], plain)
    assert (image[:, 3:] >= 0).all()
    assert (image[:, 3:] <= 1).all()
    shuffled = np.random.default_rng(1).permutation(points)
    assert np.array_equal(image, raster(shuffled, -1.0))
    distinct = np.unique(image, axis=0)
    assert len(distinct) == min(n, 256)  # repeated points repeat their features


def test_repeated_points_are_no_neighbours():
    points = cloud(40, spread=(15.0, 15.0, 3.0)).astype(np.float32)
    once, often = (
        PointFeaturesRaster(count=count, preprocessing=WHOLE)(points, 0.0) for count in (40, 120)
    )
    assert np.array_equal(np.unique(once, axis=0), np.unique(often, axis=0))


def test_a_scan_without_points_has_zeros():
    assert not PointFeaturesRaster(count=16)(np.zeros((0, 3), np.float32), 0.0).any()


def test_a_turn_of_the_raster_turns_points_and_leaves_features():
    import torch

    points = cloud(200, spread=(15.0, 15.0, 3.0)).astype(np.float32)
    raster = PointFeaturesRaster(count=200, preprocessing=WHOLE)
    image = torch.from_numpy(raster(points, 0.0))[None]
    turned = raster.turned(image, torch.tensor([90]))[0]
    assert torch.equal(turned[:, 3:], image[0, :, 3:])
    assert torch.allclose(turned[:, 0], -image[0, :, 1], atol=1e-3)
    assert torch.allclose(turned[:, 1], image[0, :, 0], atol=1e-3)
    assert torch.equal(turned[:, 2], image[0, :, 2])


@pytest.mark.parametrize(
    ("message", "make"),
    [
        (r"raster\.count: 0", lambda: PointFeaturesRaster(count=0)),
        (r"raster\.extent: 0", lambda: PointFeaturesRaster(extent=0)),
        (r"reaches to 80 m", lambda: PointFeaturesRaster(extent=80.0)),
        (r"raster\.neighbours: \[\]", lambda: PointFeaturesRaster(neighbours=())),
        (r"raster\.neighbours: \[30, 20\]", lambda: PointFeaturesRaster(neighbours=(30, 20))),
        (r"sizes: \[20, 20\]", lambda: adaptive_features(cloud(5), [20, 20])),
    ],
)
def test_bad_values_are_named(message, make):
    with pytest.raises(ConfigError, match=message):
        make()


def test_points_that_are_none_are_refused():
    with pytest.raises(DataError, match=r"points: shape \(4, 2\), expected \(n, 3\)"):
        adaptive_features(np.zeros((4, 2)))
    with pytest.raises(DataError, match="points: some are NaN"):
        adaptive_features(np.full((4, 3), np.nan))

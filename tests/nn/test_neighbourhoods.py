"""Farthest points, balls and interpolation against plain loops over all points."""

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from deepring.errors import ConfigError, DataError
from deepring.nn.neighbourhoods import ball_query, farthest_points, interpolated, nearest_points


def clouds(batch, n, seed=0):
    return torch.rand(batch, n, 3, generator=torch.Generator().manual_seed(seed)) * 10


def farthest_by_loop(points, number):
    chosen = [0]
    while len(chosen) < number:
        away = [min(np.sum((p - points[c]) ** 2) for c in chosen) for p in points]
        chosen.append(int(np.argmax(away)))
    return chosen


@pytest.mark.parametrize("number", [1, 2, 17, 40])
def test_each_farthest_point_is_that_of_a_loop(number):
    points = clouds(3, 40)
    found = farthest_points(points, number)
    for cloud, chosen in zip(points.numpy(), found.tolist(), strict=True):
        assert chosen == farthest_by_loop(cloud, number)
        assert len(set(chosen)) == number


def test_farthest_points_cover_a_cloud_better_than_the_first_ones():
    points = clouds(1, 500, 3)

    def reach(chosen):
        return KDTree(points[0][chosen].numpy()).query(points[0].numpy())[0].max()

    assert reach(farthest_points(points, 40)[0]) < 0.8 * reach(torch.arange(40))


def test_clouds_with_fewer_places_than_points_are_asked_for():
    points = torch.zeros(1, 5, 3)
    points[0, 3] = 1.0
    assert farthest_points(points, 4).tolist() == [[0, 3, 0, 0]]
    with pytest.raises(DataError, match="points: 5 in a cloud, expected at least number=6"):
        farthest_points(points, 6)


@pytest.mark.parametrize("radius", [0.5, 2.0, 50.0])
@pytest.mark.parametrize("number", [1, 8, 64])
def test_balls_are_those_of_a_loop(radius, number):
    points, centres = clouds(2, 50, 1), clouds(2, 9, 2)
    found = ball_query(centres, points, radius, number)
    assert found.shape == (2, 9, number)
    for cloud, around, rows in zip(points.numpy(), centres.numpy(), found.tolist(), strict=True):
        for centre, row in zip(around, rows, strict=True):
            away = np.linalg.norm(cloud - centre, axis=1)
            inside = np.flatnonzero(away <= radius).tolist()[:number]
            filler = inside[0] if inside else int(away.argmin())
            assert row == inside + [filler] * (number - len(inside))


def test_the_nearest_are_those_of_a_tree():
    points, centres = clouds(2, 80, 4), clouds(2, 30, 5)
    found = nearest_points(centres, points, 6)
    for cloud, around, rows in zip(points.numpy(), centres.numpy(), found.numpy(), strict=True):
        assert np.array_equal(KDTree(cloud).query(around, k=6)[1], rows)


def test_features_between_points_are_weighted_by_inverse_squares():
    points, centres = clouds(2, 20, 6), clouds(2, 7, 7)
    features = torch.randn(2, 20, 5, generator=torch.Generator().manual_seed(8))
    found = interpolated(features, points, centres)
    for b in range(2):
        for m in range(7):
            away = np.linalg.norm((points[b] - centres[b, m]).numpy(), axis=1)
            near = np.argsort(away)[:3]
            weights = 1 / away[near] ** 2
            expected = (weights[:, None] * features[b].numpy()[near]).sum(0) / weights.sum()
            np.testing.assert_allclose(found[b, m].numpy(), expected, atol=1e-4)
    same = interpolated(features, points, points)  # at the points themselves
    torch.testing.assert_close(same, features, atol=1e-3, rtol=0)
    constant = interpolated(torch.ones_like(features), points, centres)
    torch.testing.assert_close(constant, torch.ones_like(found))
    few = interpolated(features[:, :2], points[:, :2], centres)
    assert torch.isfinite(few).all()


def test_gradients_reach_the_features():
    points, features = clouds(1, 6), torch.randn(1, 6, 2, requires_grad=True)
    interpolated(features, points, clouds(1, 4, 9)).sum().backward()
    assert float(features.grad.sum()) == pytest.approx(8.0, abs=1e-4)


def test_empty_clouds_and_wrong_numbers_are_named():
    none, some = torch.zeros(1, 0, 3), clouds(1, 3)
    with pytest.raises(DataError, match="points: 0 in a cloud, expected at least 1"):
        ball_query(some, none, 1.0, 2)
    with pytest.raises(DataError, match="points: 0 in a cloud, expected at least 1"):
        interpolated(none, none, some)
    with pytest.raises(ConfigError, match="number: 0"):
        nearest_points(some, some, 0)
    with pytest.raises(ConfigError, match="radius: -1"):
        ball_query(some, some, -1.0, 2)
    assert ball_query(none, some, 1.0, 2).shape == (1, 0, 2)

"""Features of neighbourhoods: known values, loops, what turns and translations leave alone."""

import math

import numpy as np
import pytest

from deepring.core.rigid import turn_points
from deepring.rasters.local_features import FEATURES, local_features, nearest


def grid(*counts):
    """A lattice of unit steps around the origin, (n, 3)."""
    axes = [np.arange(n) - (n - 1) / 2 for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def tilted(points):
    """Turned about an axis that is none of the frame's."""
    axis = np.array([1.0, 2.0, 3.0]) / math.sqrt(14)
    cross = np.cross(np.eye(3), axis)
    return points @ (np.eye(3) + math.sin(1.0) * cross + (1 - math.cos(1.0)) * cross @ cross)


def features_of(points):
    """Of points that are all each other's neighbours: the same for each, by name."""
    rows = local_features(points, neighbours=len(points))
    assert np.allclose(rows, rows[0], atol=1e-4)  # the cube root of a rounding error
    return dict(zip(FEATURES, rows[0].tolist(), strict=True))


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (grid(25, 1, 1), [0, 0, 0, 0, 0, 0]),
        (grid(1, 1, 5), [0, 0, 0, 0, 4, 2]),
        (grid(5, 5, 1), [0, 0, math.log(2), 1, 0, 0]),
        (grid(1, 5, 5), [0, 0, math.log(2), 0, 4, 2]),
        (grid(3, 3, 3), [1 / 3, 1 / 3, math.log(3), 1, 2, 2 / 3]),
    ],
    ids=["line", "pole", "ground", "wall", "ball"],
)
def test_a_line_a_plane_and_a_ball_have_their_known_values(points, expected):
    assert np.allclose(list(features_of(points).values()), expected, atol=1e-4)
    # The first three are of the shape alone, whichever way it stands; the rest know the vertical.
    slanted = list(features_of(tilted(points)).values())
    assert np.allclose(slanted[:3], expected[:3], atol=1e-4)
    if expected[0] == 0:
        assert not np.allclose(slanted[3:], expected[3:], atol=1e-2)


def test_a_box_has_the_features_of_its_eigenvalues():
    # Steps of 1 in n places have the variance (n² - 1) / 12.
    sizes = 7, 5, 3
    values = np.array([(n**2 - 1) / 12 for n in sizes])
    share = values / values.sum()
    found = features_of(grid(*sizes))
    assert found["curvature"] == pytest.approx(share[2])
    assert found["omnivariance"] == pytest.approx(share.prod() ** (1 / 3))
    assert found["entropy"] == pytest.approx(-(share * np.log(share)).sum())
    assert found["flatness"] == pytest.approx(values[1] / values[0])  # not its inverse
    assert found["reach"] == pytest.approx(2)
    assert found["variance"] == pytest.approx(values[2])


def test_neighbourhoods_against_a_loop():
    points = np.random.default_rng(0).normal(0, 5, (200, 3))
    found = local_features(points, neighbours=12)

    def by_hand(near):
        values = np.linalg.eigvalsh(np.cov(near.T))
        low, high = np.linalg.eigvalsh(np.cov(near[:, :2].T))
        share, z = values / values.sum(), near[:, 2]
        omnivariance = np.prod(share) ** (1 / 3)
        entropy = -(share * np.log(share)).sum()
        return [share[0], omnivariance, entropy, low / high, z.max() - z.min(), z.var()]

    for k, point in enumerate(points):
        order = np.argsort(np.linalg.norm(points - point, axis=1))
        assert set(order[:12]) == set(nearest(points, 12)[k])
        assert np.allclose(found[k], by_hand(points[order[:12]]), atol=1e-9)
        # A point is among its own neighbours.
        assert not np.allclose(found[k], by_hand(points[order[1:13]]), atol=1e-4)


def test_turns_about_the_vertical_and_translations_change_nothing():
    points = np.random.default_rng(1).normal(0, 5, (300, 3))
    features = local_features(points)
    turned = turn_points(points.astype(np.float32), 0.7)
    assert np.allclose(local_features(turned), features, atol=1e-4)
    assert np.allclose(local_features(points + np.array([30.0, -20.0, 4.0])), features, atol=1e-9)
    assert not np.allclose(local_features(tilted(points)), features, atol=0.1)


def test_scale_changes_heights_alone():
    points = np.random.default_rng(2).normal(0, 5, (300, 3))
    features, doubled = local_features(points), local_features(2 * points)
    assert np.allclose(doubled, features * [1, 1, 1, 1, 2, 4])


@pytest.mark.parametrize("n", [0, 1, 2, 29, 30, 31])
def test_any_number_of_points_has_finite_features(n):
    points = np.random.default_rng(3).normal(0, 5, (n, 3))
    found = local_features(points)
    assert found.shape == (n, 6)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert found.any() == (n > 1)
    if n:
        assert nearest(points, 30).shape == (n, min(n, 30))


def test_points_that_coincide_have_zeros():
    assert not local_features(np.ones((40, 3))).any()

"""Spacing, revisits and the validation split against literal loops of the protocol."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.data.spacing import far_half_plane, revisits, sample_by_distance
from deepring.errors import DeepringError


def walk(seed, n=200, step=1.5):
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0, 0.3, n))
    return np.cumsum(step * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)


#: Metres that no distance of a walk equals, so that rounding decides nothing.
metres = st.integers(1, 60).map(lambda k: k / 2 + 0.0371)


def kept_by_protocol(positions, spacing, mask):
    """A scan is kept when its distance from the last kept scan exceeds the spacing."""
    kept = []
    for i, position in enumerate(positions):
        if mask[i] and (not kept or math.dist(position, positions[kept[-1]]) > spacing):
            kept.append(i)
    return kept


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), metres, st.floats(0, 1))
def test_spacing_against_the_protocol(seed, spacing, share):
    positions = walk(seed)
    mask = np.random.default_rng(seed).random(len(positions)) <= share
    indices = sample_by_distance(positions, spacing, mask)
    assert indices.dtype == np.int64
    assert indices.tolist() == kept_by_protocol(positions, spacing, mask)


def test_the_mask_comes_before_the_spacing():
    positions = np.column_stack([np.arange(10.0), np.zeros(10)])
    mask = positions[:, 0] >= 2
    assert sample_by_distance(positions, 3.5, mask).tolist() == [2, 6]
    # Spacing first and the mask afterwards would keep others.
    first = sample_by_distance(positions, 3.5, np.ones(10, dtype=bool))
    assert [i for i in first if mask[i]] == [4, 8]


def test_distances_are_straight_and_not_along_the_path():
    there_and_back = np.array([[0.0, 0], [4, 0], [0, 0], [4, 0], [6, 0]])
    every = np.ones(5, dtype=bool)
    assert sample_by_distance(there_and_back, 5.0, every).tolist() == [0, 4]  # not [0, 2, 4]


def test_a_scan_at_exactly_the_spacing_is_not_kept():
    positions = np.array([[0.0, 0], [5, 0], [5.001, 0]])
    assert sample_by_distance(positions, 5.0, np.ones(3, dtype=bool)).tolist() == [0, 2]


def test_spacing_zero_keeps_all_even_of_a_standing_robot():
    standing = np.zeros((4, 2))
    assert sample_by_distance(standing, 0.0, np.ones(4, dtype=bool)).tolist() == [0, 1, 2, 3]


def test_nothing_in_the_mask_keeps_nothing():
    assert sample_by_distance(walk(0, 5), 1.0, np.zeros(5, dtype=bool)).shape == (0,)


@pytest.mark.parametrize("bad", [-1.0, math.nan])
def test_a_bad_spacing_is_named(bad):
    with pytest.raises(DeepringError, match="spacing: "):
        sample_by_distance(walk(0, 5), bad, np.ones(5, dtype=bool))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), metres, metres.map(lambda m: 4 * m))
def test_revisits_against_brute_force(seed, radius, apart):
    positions = walk(seed, 120)
    path = [0.0]
    for a, b in itertools.pairwise(positions):
        path.append(path[-1] + math.dist(a, b))
    brute = [
        any(
            math.dist(positions[i], positions[j]) <= radius and path[j] < path[i] - apart
            for j in range(i)
        )
        for i in range(len(positions))
    ]
    assert revisits(positions, radius, apart).tolist() == brute


def test_the_second_lap_revisits_the_first():
    angle = np.linspace(0, 4 * np.pi, 200, endpoint=False)
    laps = 50 * np.column_stack([np.cos(angle), np.sin(angle)])
    again = revisits(laps, radius=5.0)
    assert not again[:95].any()
    assert again[100:].all()


def test_neighbours_on_the_same_pass_are_no_revisits():
    line = np.column_stack([np.arange(300.0), np.zeros(300)])
    assert not revisits(line, radius=10.0, apart=100.0).any()
    assert revisits(line, radius=10.0, apart=5.0).any()  # too little path between them


def test_revisits_keep_their_answer_at_utm_coordinates():
    positions = np.round(walk(7, 300, step=4.0) * 8) / 8  # exact at either place
    assert revisits(positions).any()
    assert np.array_equal(revisits(positions), revisits(positions + np.array([345090, 4037591])))


@pytest.mark.parametrize("n", [0, 1])
def test_revisits_of_almost_no_scan(n):
    assert revisits(np.zeros((n, 2))).tolist() == [False] * n


@pytest.mark.parametrize(("radius", "apart"), [(-1.0, 100.0), (10.0, -1.0), (math.nan, 1.0)])
def test_bad_revisits_are_named(radius, apart):
    with pytest.raises(DeepringError, match=r"(radius|apart): .*metres of at least 0"):
        revisits(walk(0, 5), radius, apart)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 999), st.floats(0.02, 0.98), st.floats(0, 3))
def test_far_half_plane_holds_the_share(seed, share, heading):
    rng = np.random.default_rng(seed)
    c, s = math.cos(heading), math.sin(heading)
    positions = rng.normal(0, 1, (200, 2)) * [100, 20] @ [[c, s], [-s, c]] + [3e5, 4e6]
    inside = far_half_plane(positions, share).contains(positions)
    assert abs(inside.sum() - 200 * share) <= 1


def test_far_half_plane_cuts_across_the_longest_direction():
    positions = np.random.default_rng(0).uniform(-1, 1, (500, 2)) * [200, 30]
    plane = far_half_plane(positions, 0.2)
    inside = plane.contains(positions)
    assert abs(plane.normal[0]) > 0.99
    assert positions[inside, 0].min() > positions[~inside, 0].max() - 10
    # Across the short side it would leave both regions side by side along the whole drive.
    assert np.ptp(positions[inside, 0]) < np.ptp(positions[inside, 1]) * 2
    assert np.ptp(positions[~inside, 0]) > np.ptp(positions[~inside, 1]) * 4


def test_far_half_plane_is_the_same_for_any_order_of_the_scans():
    positions = walk(3, 150)
    there, back = far_half_plane(positions, 0.15), far_half_plane(positions[::-1], 0.15)
    assert np.allclose(there.normal, back.normal)
    assert np.allclose(there.point, back.point)

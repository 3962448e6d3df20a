"""Scan Context against brute-force loops over column shifts and ring keys; the turn's sign."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import DeepringError
from deepring.methods.method import Method
from deepring.methods.scan_context import ScanContext
from deepring.rasters import ContextRaster
from helpers.scenes import scattered


def contexts(n, sectors, rings, seed, empty=0.3):
    """Random heights in which some columns and some cells are empty."""
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0.1, 9, (n, sectors, rings))
    heights[rng.random((n, sectors)) < empty] = 0
    heights[rng.random(heights.shape) < 0.2] = 0
    return heights


def distance_by_loop(query, entry):
    """1 - mean cosine over the columns that are non-empty in both, least over all shifts."""
    sectors = len(query)
    best = math.inf
    for shift in range(sectors):
        cosines = []
        for k in range(sectors):
            a, b = query[(k + shift) % sectors], entry[k]
            if a.any() and b.any():
                cosines.append(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
        best = min(best, 1 - (sum(cosines) / len(cosines) if cosines else 0.0))
    return best


def as_tensor(heights):
    return torch.from_numpy(heights).float()


@settings(max_examples=40, deadline=None)
@given(
    st.integers(1, 3),
    st.integers(1, 3),
    st.integers(1, 9),
    st.integers(1, 6),
    st.integers(0, 999),
    st.sampled_from([0.0, 0.4, 0.8, 1.0]),
)
def test_distance_against_a_loop_over_all_shifts(q, d, sectors, rings, seed, empty):
    queries = contexts(q, sectors, rings, seed, empty)
    database = contexts(d, sectors, rings, seed + 1, 0.4)
    score = ScanContext().compare(as_tensor(queries), as_tensor(database)).score
    for i in range(q):
        for j in range(d):
            expected = distance_by_loop(queries[i], database[j])
            assert 1 - score[i, j].item() == pytest.approx(expected, abs=2e-5)


def test_empty_columns_do_not_count():
    full = contexts(1, 12, 5, seed=0, empty=0.0)
    half = full.copy()
    half[:, 6:] = 0
    score = ScanContext().compare(as_tensor(half), as_tensor(full)).score.item()
    assert score == pytest.approx(1.0, abs=1e-5)  # not 1/2, the mean over all columns


def test_two_empty_scans_have_nothing_in_common():
    empty = torch.zeros(2, 12, 5)
    score, turn = ScanContext().compare(empty, torch.cat([empty, as_tensor(contexts(1, 12, 5, 0))]))
    assert torch.equal(score, torch.zeros(2, 3))
    assert torch.isfinite(turn).all()


@pytest.mark.parametrize("shift", [0, 1, 5, 29, 31, 59])
def test_a_shift_of_the_columns_costs_nothing_and_is_the_yaw(shift):
    entry = as_tensor(contexts(1, 60, 20, seed=1))
    score, turn = ScanContext().compare(entry.roll(shift, dims=1), entry)
    assert score.item() == pytest.approx(1.0, abs=1e-5)
    wanted = shift * 2 * math.pi / 60
    wanted = wanted if wanted < math.pi else wanted - 2 * math.pi
    assert turn.item() == pytest.approx(wanted, abs=1e-5)


def test_the_yaw_is_the_turn_of_the_points_from_entry_to_query():
    method, points = ScanContext(), scattered(0)
    steps = 7
    turned = turn_points(points, steps * 2 * math.pi / 60)
    query, entry = (
        method.describe(torch.from_numpy(method.raster(p, 0.0))[None]) for p in (turned, points)
    )
    score, turn = method.compare(query, entry)
    assert score > 0.97
    assert turn.item() == pytest.approx(steps * 2 * math.pi / 60, abs=1e-4)  # not its negative
    assert method.compare(entry, query).turn.item() == pytest.approx(-turn.item(), abs=1e-4)


def test_scores_are_symmetric():
    one, other = (as_tensor(contexts(4, 12, 5, seed)) for seed in (2, 3))
    forth, back = ScanContext().compare(one, other), ScanContext().compare(other, one)
    assert torch.allclose(forth.score, back.score.T, atol=1e-5)


def nearest_keys(queries, database, count):
    """By the mean of each ring over the sectors, Euclidean, in float64."""
    keep = np.zeros((len(queries), len(database)), dtype=bool)
    for i, query in enumerate(queries):
        apart = [np.linalg.norm(query.mean(axis=0) - entry.mean(axis=0)) for entry in database]
        keep[i, np.argsort(apart)[:count]] = True
    return keep


@pytest.mark.parametrize("count", [1, 3, 10])
@pytest.mark.parametrize("entries", [12, 60])
def test_candidates_against_brute_force(count, entries):
    queries, database = contexts(5, 12, 6, seed=4), contexts(entries, 12, 6, seed=5)
    every = ScanContext().compare(as_tensor(queries), as_tensor(database)).score
    some = ScanContext(candidates=count).compare(as_tensor(queries), as_tensor(database)).score
    keep = torch.from_numpy(nearest_keys(queries, database, count))
    assert torch.equal(some[keep], every[keep])
    assert (some[~keep] < every.min()).all()
    assert torch.equal(some > -1, keep)


def test_keys_that_are_close_keep_their_order():
    # Heights of some metres, keys that differ by a millimetre: matrix products cannot tell.
    base = np.full((40, 12, 6), 8.0)
    base[:, :, 0] += 1e-3 * np.arange(40)[:, None]
    keep = ScanContext(candidates=1).compare(as_tensor(base), as_tensor(base)).score > -1
    assert torch.equal(keep, torch.eye(40, dtype=torch.bool))


def test_candidates_are_the_same_for_a_turned_query():
    queries, database = contexts(3, 12, 6, seed=6), contexts(30, 12, 6, seed=7)
    method = ScanContext(candidates=4)
    plain = method.compare(as_tensor(queries), as_tensor(database)).score
    turned = method.compare(as_tensor(np.roll(queries, 5, axis=1)), as_tensor(database)).score
    assert torch.allclose(plain, turned, atol=1e-5)


@pytest.mark.parametrize("candidates", [None, 4, 5, 100])
def test_as_many_candidates_as_entries_compare_all(candidates):
    one = as_tensor(contexts(4, 12, 5, seed=8))
    assert (ScanContext(candidates=candidates).compare(one, one).score > -1).all()


@pytest.mark.parametrize("bad", [0, -1])
def test_bad_candidates_are_named(bad):
    with pytest.raises(DeepringError, match=r"candidates: (0|-1)"):
        ScanContext(candidates=bad)


def test_it_is_a_method_of_20_rings_and_60_sectors():
    method = ScanContext()
    assert isinstance(method, Method)
    assert method.raster == ContextRaster(sectors=60, rings=20, radius=80.0)
    image = torch.from_numpy(method.raster(scattered(1), 0.0))[None]
    described = method.describe(image)
    assert described.shape == (1, 60, 20)
    assert described.dtype == torch.float32

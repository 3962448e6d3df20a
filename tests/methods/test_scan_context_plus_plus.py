"""Scan Context++: cells, keys, and the shifts near the key's, against loops."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.rigid import turn_points
from deepring.errors import ConfigError, DeepringError
from deepring.methods.method import index_of
from deepring.methods.scan_context import ScanContext
from deepring.methods.scan_context_plus_plus import (
    CartContext,
    PolarContext,
    aligned_cosines,
    retrieval_keys,
)
from deepring.rasters import (
    CartContextRaster,
    PolarContextRaster,
    make_raster,
    raster_settings,
)
from deepring.rasters.cart_context import cart_context
from deepring.rasters.polar_context import polar_context
from deepring.search.compare_index import CompareIndex
from deepring.search.shortlist import ShortlistIndex
from deepring.testing import walls


def contexts(n, copies, columns, rows, seed, empty=0.3):
    """Random heights in which some columns and some cells are empty."""
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0.1, 9, (n, copies, columns, rows))
    heights[rng.random(heights.shape[:3]) < empty] = 0
    heights[rng.random(heights.shape) < 0.2] = 0
    return torch.from_numpy(heights).float()


def aligned_by_loop(query, entry, window):
    """The best mean cosine within the window of the shift of the nearest aligning keys."""
    columns = len(query)
    key, other = query.mean(axis=1), entry.mean(axis=1)
    apart = [np.linalg.norm(key - np.roll(other, s)) for s in range(columns)]
    half, best = round(0.5 * window * columns), (-math.inf, 0)
    for offset in range(-half, half + 1):
        shift = (int(np.argmin(apart)) + offset) % columns
        cosines = [
            a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
            for a, b in zip(query, np.roll(entry, shift, axis=0), strict=True)
            if a.any() and b.any()
        ]
        best = max(best, (np.mean(cosines) if cosines else 0.0, shift))
    return best


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 14), st.integers(1, 6), st.sampled_from([0.05, 0.1, 0.4, 3.0]), st.integers())
def test_scores_against_a_loop(columns, rows, window, seed):
    queries = contexts(3, 1, columns, rows, abs(seed) % 1000)[:, 0]
    places = contexts(2, 1, columns, rows, abs(seed) % 1000 + 1)[:, 0]
    score, _ = aligned_cosines(queries, places, window)
    for q in range(3):
        for d in range(2):
            expected, _ = aligned_by_loop(queries[q].numpy(), places[d].numpy(), window)
            assert score[q, d].item() == pytest.approx(expected, abs=2e-5)


def test_with_the_widest_window_it_is_scan_context():
    queries, places = contexts(3, 1, 60, 20, 1), contexts(9, 1, 60, 20, 2)
    wide = PolarContext(candidates=None, window=2.0).compare(queries, places)
    plain = ScanContext().compare(queries[:, 0], places[:, 0])
    assert torch.allclose(wide.score, plain.score, atol=1e-6)
    assert torch.equal(wide.turn, plain.turn)
    narrow = PolarContext(candidates=None).compare(queries, places).score
    assert (narrow <= plain.score + 1e-6).all()
    assert (narrow < plain.score - 1e-3).any()  # the key may propose another shift than the best


@pytest.mark.parametrize("shift", [0, 1, 29, 59])
def test_a_roll_costs_nothing_and_is_the_turn(shift):
    entry = contexts(1, 1, 60, 20, 3)
    query = entry.roll(shift, dims=2)
    score, turn = PolarContext().compare(query, entry)
    assert score.item() == pytest.approx(1, abs=1e-5)
    wanted = shift * 2 * math.pi / 60
    assert turn.item() == pytest.approx(wanted - 2 * math.pi * (wanted > math.pi), abs=1e-5)
    assert torch.allclose(retrieval_keys(query), retrieval_keys(entry), atol=1e-5)


def test_the_turn_is_that_of_the_points_from_entry_to_query():
    method, points = PolarContext(PolarContextRaster(grid=None)), walls(0)
    turned = turn_points(points, 7 * 2 * math.pi / 60)
    query, entry = (method.describe(method.raster(p, 0.0)[None]) for p in (turned, points))
    score, turn = method.compare(query, entry)
    assert score > 0.95
    assert turn.item() == pytest.approx(7 * 2 * math.pi / 60, abs=1e-4)  # not its negative


def test_cells_with_few_points_are_empty():
    four = np.tile([30.0, 1.0, 2.0], (4, 1))
    assert not polar_context(four).any()
    five = np.concatenate([four, [[30.0, 1.0, 3.5]]])
    assert polar_context(five)[0, 7] == 3.5
    assert (polar_context(five) > 0).sum() == 1
    assert polar_context(four, least=4)[0, 7] == 2.0


def test_points_beyond_the_radius_are_in_the_last_ring():
    assert polar_context(np.array([[150.0, 1.0, 4.0]]), least=1)[0, 19] == 4


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 30), st.integers(1, 9), st.integers(1, 4), st.integers(0, 999))
def test_polar_cells_against_a_loop(sectors, rings, least, seed):
    points = np.random.default_rng(seed).normal(size=(150, 3)) * [25, 25, 4]
    members = {}
    for x, y, z in points:
        sector = int(math.atan2(y, x) / (2 * math.pi) % 1 * sectors)
        ring = min(int(math.hypot(x, y) / 40 * rings), rings - 1)
        members.setdefault((sector, ring), []).append(z)
    expected = np.zeros((sectors, rings))
    for cell, heights in members.items():
        expected[cell] = max(0.0, *heights) if len(heights) >= least else 0.0
    assert np.allclose(polar_context(points, 40.0, sectors, rings, least), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("x", "y", "cell"),
    [
        (0.1, 0.1, (20, 20)),
        (-4.9, -1.9, (20, 20)),  # the middle cells are twice as wide
        (5.1, 2.1, (21, 21)),
        (-5.1, -2.1, (19, 19)),
        (99.9, 39.9, (39, 39)),
        (-99.9, -39.9, (1, 1)),
        (5.1, 0.1, (20, 21)),  # forward is the second axis
        (100.1, 0.1, None),
        (0.1, -40.1, None),
    ],
)
def test_cartesian_cells(x, y, cell):
    image = cart_context(np.array([[x, y, 3.0]]))
    assert [tuple(place) for place in np.argwhere(image)] == ([] if cell is None else [cell])


def test_a_lateral_move_shifts_the_columns():
    rng = np.random.default_rng(0)
    points = np.column_stack(
        [rng.uniform(-90, 90, 300), rng.uniform(3, 30, 300), rng.uniform(1, 5, 300)]
    )
    image, moved = cart_context(points), cart_context(points + np.array([0, 2, 0]))
    assert np.array_equal(moved[22:], image[21:-1])
    score, turn = CartContext(candidates=None).compare(
        torch.from_numpy(moved)[None, None], torch.from_numpy(image)[None, None]
    )
    assert score.item() == pytest.approx(1, abs=1e-5)
    assert turn is None


def cart_score(query, entry, **settings):
    method = CartContext(CartContextRaster(**settings))
    one, other = (method.describe(method.raster(p, 0.0)[None]) for p in (query, entry))
    return method.compare(one, other).score.item()


def test_the_way_back_needs_the_context_of_the_way_back():
    points = walls(4)
    back = points * np.float32([-1, -1, 1])
    assert cart_score(back, points, reverse=True, grid=None) == pytest.approx(1, abs=1e-5)
    assert cart_score(back, points, grid=None) < 0.95
    aside = turn_points(points, math.pi / 2)
    assert cart_score(aside, points, reverse=True, grid=None) < 0.95  # by design


def test_origins_to_the_side_find_a_place_from_there():
    points = walls(5)
    raster = PolarContextRaster(grid=None, sideways=(0, 2, -2))
    found = raster(points, 0.0)
    for k, aside in enumerate((0, 2, -2)):
        alone = PolarContextRaster(grid=None)(points - np.float32([0, aside, 0]), 0.0)
        assert np.array_equal(found[k], alone[0])
    method = PolarContext(raster)
    seen_from_the_left = points - np.float32([0, 2, 0])
    query, entry = (
        method.describe(raster(scan, 0.0)[None]) for scan in (seen_from_the_left, points)
    )
    assert method.compare(query, entry).score.item() == pytest.approx(1, abs=1e-5)
    single = PolarContext(PolarContextRaster(grid=None))
    assert single.compare(query[:, :1], entry[:, :1]).score.item() < 0.99


def test_points_are_averaged_in_a_grid_first():
    twice = np.concatenate([np.tile([30.2, 1.2, z], (5, 1)) for z in (2.1, 2.3)])
    assert not PolarContextRaster()(twice, 0.0).any()  # all ten are one
    assert PolarContextRaster(least=1)(twice, 0.0).max() == pytest.approx(2.2, abs=0.01)
    assert PolarContextRaster(grid=None)(twice, 0.0).max() == pytest.approx(2.3, abs=0.01)


@pytest.mark.parametrize("copies", [1, 3])
@pytest.mark.parametrize("candidates", [None, 4, 99])
def test_the_index_finds_what_compare_finds(copies, candidates):
    raster = PolarContextRaster(12, 6, sideways=(0, 2, -2)[:copies])
    method = PolarContext(raster, candidates, window=0.5)
    places, queries = contexts(20, copies, 12, 6, 5), contexts(4, copies, 12, 6, 6)
    index = index_of(method)
    assert type(index) is (CompareIndex if candidates is None else ShortlistIndex)
    index.add(places[:7])
    index.add(places[7:])
    expected = method.compare(queries, places)
    hits = index.search(queries, 3)
    assert torch.allclose(hits.score, expected.score.topk(3).values, atol=1e-6)
    assert torch.allclose(hits.score, expected.score.gather(1, hits.place), atol=1e-6)
    assert torch.allclose(hits.turn, expected.turn.gather(1, hits.place))
    if candidates == 4:
        assert (expected.score > -1).sum(dim=1).tolist() == [4] * 4


def test_one_origin_can_be_turned_and_several_cannot():
    images = contexts(2, 1, 60, 20, 7)
    found = PolarContextRaster().turned(images, torch.tensor([3, -1]))
    assert torch.equal(found[0], images[0].roll(3, dims=1))
    with pytest.raises(ConfigError, match=r"raster\.sideways: 2 origins, expected one"):
        PolarContextRaster(sideways=(0, 2)).turned(images, torch.tensor([3, -1]))
    with pytest.raises(ConfigError, match="CartContextRaster cannot be turned"):
        _ = CartContextRaster().sectors


def test_empty_scans_are_alike_in_nothing():
    for method in (PolarContext(), CartContext()):
        blank = method.raster(np.zeros((0, 3)), 0.0)
        assert method.raster.is_blank(blank)
        both = method.describe(np.stack([blank, method.raster(walls(0), 0.0)]))
        score = method.compare(both, both).score
        assert score.tolist() == [[0, 0], [0, pytest.approx(1, abs=1e-5)]]


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: PolarContextRaster(sideways=(2.0,)), r"raster\.sideways: .* the first is 0"),
        (lambda: PolarContextRaster(sideways=()), r"raster\.sideways: \(\)"),
        (lambda: PolarContextRaster(sideways=2.0), r"raster\.sideways: 2\.0, expected a list"),
        (lambda: PolarContextRaster(sideways=(0, "a")), r"raster\.sideways: 'a'"),
        (lambda: PolarContextRaster(least=0), r"raster\.least: 0"),
        (lambda: CartContextRaster(across=41), r"raster\.across: 41, expected an even number"),
        (lambda: CartContextRaster(grid=0.0), r"raster\.grid"),
        (lambda: CartContextRaster(length=90.0), r"preprocessing\.extent: 200 m"),
        (lambda: CartContextRaster(reverse=2), r"raster\.reverse"),
        (lambda: PolarContext(candidates=0), r"Scan Context\+\+: candidates: 0"),
        (lambda: PolarContext(window=0.0), r"Scan Context\+\+: window: 0"),
        (lambda: CartContext(PolarContextRaster()), r"Cart Context: raster: a PolarContextRaster"),
    ],
)
def test_bad_settings_are_named(make, complaint):
    with pytest.raises(DeepringError, match=complaint):
        make()


def test_rasters_are_remade_from_their_settings():
    raster = PolarContextRaster(sideways=(0, 2, -2))
    settings = raster_settings(raster)
    listed = {**settings, "sideways": [0.0, 2.0, -2.0]}
    assert make_raster(settings) == make_raster(listed) == raster

"""FFT correlation against a brute-force loop; the sign of the shift; symmetry and invariance."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core import correlation
from deepring.core.correlation import (
    circular_cross_correlation,
    correlation_curves,
    magnitude_correlation_curves,
    shift_to_turn,
    standardise,
    unit_norm,
)
from deepring.core.spectrum import row_dft_magnitude, standardise_spectrum


def maps(n, rows, cols, seed):
    return torch.randn(n, rows, cols, generator=torch.Generator().manual_seed(seed))


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 3), st.integers(1, 4), st.integers(2, 9), st.integers(1, 5), st.integers(0, 99)
)
def test_matches_the_double_sum_of_equation_8(q, d, rows, cols, seed):
    queries, database = maps(q, rows, cols, seed), maps(d, rows, cols, seed + 1)
    brute = torch.zeros(q, d, rows)
    for i in range(q):
        for j in range(d):
            for alpha in range(rows):
                for theta in range(rows):
                    brute[i, j, alpha] += (
                        queries[i, (theta + alpha) % rows] * database[j, theta]
                    ).sum()
    curves = correlation_curves(queries, database)
    assert torch.allclose(curves, brute, atol=1e-4)
    match = circular_cross_correlation(queries, database)
    assert torch.allclose(match.score, brute.amax(-1), atol=1e-4)


def test_the_shift_rolls_the_entry_onto_the_query():
    entry = maps(1, 12, 5, 0)
    match = circular_cross_correlation(entry.roll(3, dims=-2), entry)
    assert match.shift.item() == 3  # not 9, its mirror
    assert torch.allclose(match.score, entry.square().sum())


def test_score_is_symmetric_and_the_shift_changes_sign():
    a, b = maps(2, 10, 4, 1), maps(3, 10, 4, 2)
    forth, back = circular_cross_correlation(a, b), circular_cross_correlation(b, a)
    assert torch.allclose(forth.score, back.score.T, atol=1e-5)
    assert torch.equal((forth.shift + back.shift.T) % 10, torch.zeros(2, 3, dtype=torch.long))


def test_score_ignores_shifts_of_either():
    a, b = maps(2, 10, 4, 3), maps(2, 10, 4, 4)
    rolled = circular_cross_correlation(a.roll(4, dims=-2), b.roll(-3, dims=-2))
    assert torch.allclose(rolled.score, circular_cross_correlation(a, b).score, atol=1e-5)


def test_shift_to_yaw_wraps_into_plus_minus_pi():
    turn = shift_to_turn(torch.tensor([0, 3, 6, 9]), 12)
    assert torch.allclose(turn, torch.tensor([0.0, math.pi / 2, -math.pi, -math.pi / 2]))


def test_normalisations():
    x = maps(3, 6, 5, 5) * 7 + 2
    z = standardise(x)
    assert torch.allclose(z.mean((-2, -1)), torch.zeros(3), atol=1e-6)
    assert torch.allclose(z.square().mean((-2, -1)), torch.ones(3), atol=1e-5)
    u = unit_norm(x)
    assert torch.allclose(circular_cross_correlation(u, u).score.diagonal(), torch.ones(3))
    for scale in (1e-3, 1e3):  # however small the values are
        assert torch.allclose(unit_norm(scale * x), u)
        assert torch.allclose(standardise(scale * x), z, atol=1e-4)
    assert torch.isfinite(standardise(torch.zeros(1, 4, 4))).all()
    assert torch.isfinite(unit_norm(torch.zeros(1, 4, 4))).all()


def test_unnormalised_correlation_lets_the_brightest_place_win():
    places = maps(5, 12, 6, 6).abs()
    places[2] *= 10
    raw = circular_cross_correlation(places, places).score.argmax(1)
    assert (raw == 2).all()
    normalised = circular_cross_correlation(unit_norm(places), unit_norm(places)).score.argmax(1)
    assert torch.equal(normalised, torch.arange(5))


def brute_magnitudes(queries, database):
    """Σ_ω |Σ_θ Q(θ + α, ω) D(θ, ω)| by loops."""
    rows, width = queries.shape[-2:]
    curves = torch.zeros(len(queries), len(database), rows)
    for i, query in enumerate(queries):
        for j, entry in enumerate(database):
            for alpha in range(rows):
                for omega in range(width):
                    inner = sum(
                        query[(theta + alpha) % rows, omega] * entry[theta, omega]
                        for theta in range(rows)
                    )
                    curves[i, j, alpha] += abs(inner)
    return curves


@settings(max_examples=15, deadline=None)
@given(
    st.integers(1, 3), st.integers(1, 4), st.integers(2, 9), st.integers(1, 5), st.integers(0, 99)
)
def test_the_published_form_takes_the_magnitude_of_each_frequency(q, d, rows, cols, seed):
    queries, database = maps(q, rows, cols, seed), maps(d, rows, cols, seed + 1)
    brute = brute_magnitudes(queries, database)
    curves = magnitude_correlation_curves(queries, database)
    assert torch.allclose(curves, brute, atol=1e-4)
    match = circular_cross_correlation(queries, database, "published")
    assert torch.allclose(match.score, brute.amax(-1), atol=1e-4)


def test_the_published_form_is_neither_the_papers_nor_its_magnitude():
    queries, database = maps(3, 9, 5, 10), maps(4, 9, 5, 11)
    published = magnitude_correlation_curves(queries, database)
    paper = correlation_curves(queries, database)
    assert (published > paper.abs() + 1e-3).float().mean() > 0.9  # summed first, values cancel
    assert (published >= paper.abs() - 1e-4).all()
    # One frequency leaves nothing to cancel, and what is nowhere opposed is the same in both.
    one = queries[..., :1], database[..., :1]
    assert torch.allclose(
        magnitude_correlation_curves(*one), correlation_curves(*one).abs(), atol=1e-4
    )
    positive = queries.abs(), database.abs()
    assert torch.allclose(
        magnitude_correlation_curves(*positive), correlation_curves(*positive), atol=1e-4
    )


@pytest.mark.parametrize("bins", [12, 13])
def test_the_published_form_sums_over_the_full_spectrum(bins):
    rows = torch.rand(5, 8, bins, generator=torch.Generator().manual_seed(12))
    full = standardise(torch.fft.fft(rows, norm="ortho").abs())
    half = standardise_spectrum(row_dft_magnitude(rows), bins)
    expected = brute_magnitudes(full[:2], full[2:])
    assert torch.allclose(magnitude_correlation_curves(half[:2], half[2:]), expected, atol=1e-3)
    # Weighing the doubled frequencies once more, or not at all, is something else.
    weights = row_dft_magnitude(torch.eye(1, bins))
    weights = weights / weights[0, 0]
    for other in (half * weights, half / weights):
        curves = magnitude_correlation_curves(other[:2], other[2:])
        assert not torch.allclose(curves, expected, rtol=1e-2)


def test_the_published_form_turns_the_same_way():
    entry = maps(1, 12, 5, 13)
    match = circular_cross_correlation(entry.roll(3, dims=-2), entry, "published")
    assert match.shift.item() == 3  # not 9, its mirror
    assert torch.allclose(match.score, entry.square().sum())


@pytest.mark.parametrize("block", [1, 60, 61, 3 * 60, 7 * 60, 10**6])
def test_the_published_form_is_the_same_in_any_blocks(block, monkeypatch):
    queries, database = maps(4, 12, 5, 14), maps(3, 12, 5, 15)
    whole = magnitude_correlation_curves(queries, database)
    shapes, inverse = [], torch.fft.irfft
    monkeypatch.setattr(correlation, "BLOCK", block)
    monkeypatch.setattr(
        torch.fft, "irfft", lambda x, **kw: shapes.append(x.shape[:2].numel()) or inverse(x, **kw)
    )
    assert torch.allclose(magnitude_correlation_curves(queries, database), whole, atol=1e-5)
    assert sum(shapes) == 12
    assert max(shapes) <= max(1, block // 60)

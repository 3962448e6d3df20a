"""The 2-D spectrum of a polar map against numpy, and phase correlation against brute force."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from deepring.core.equivariance import assert_invariant, relative_error
from deepring.core.phase import central_magnitude, phase_correlation


def maps(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def test_the_signature_against_numpy():
    feature = maps(2, 12, 10)
    spectrum = np.abs(np.fft.fftshift(np.fft.fft2(feature.numpy()), axes=(1, 2))) / np.sqrt(120)
    expected = spectrum[:, 6 - 3 : 6 + 3, 5 - 3 : 5 + 3].reshape(2, 36)
    assert np.allclose(central_magnitude(feature, 6).numpy(), expected, atol=1e-5)


def test_by_default_the_32_lowest_frequencies_of_either_axis_are_kept():
    assert central_magnitude(maps(2, 40, 48)).shape == (2, 32 * 32)
    wave = torch.cos(2 * torch.pi * 15 * torch.arange(40) / 40)[:, None].expand(40, 48)
    kept = central_magnitude(wave)
    assert kept.norm() == pytest.approx(wave.norm().item(), rel=1e-5)
    faster = torch.cos(2 * torch.pi * 17 * torch.arange(40) / 40)[:, None].expand(40, 48)
    assert central_magnitude(faster).norm() < 1e-3 * faster.norm()


@pytest.mark.parametrize("axis", [-2, -1])
def test_circular_shifts_of_the_map_leave_the_signature(axis):
    assert_invariant(
        lambda x: central_magnitude(x, 6), maps(3, 12, 10), lambda x: x.roll(5, axis), 1e-5
    )
    flipped = central_magnitude(maps(3, 12, 10).flip(-2), 6)
    assert relative_error(flipped, central_magnitude(maps(3, 12, 10), 6)) > 0.1


def test_a_vanishing_map_has_a_finite_gradient():
    feature = torch.zeros(1, 8, 8, requires_grad=True)
    central_magnitude(feature, 8).sum().backward()
    assert torch.isfinite(feature.grad).all()


def peak_by_loop(query, entry):
    """Σ of the whitened query's products with the whitened entry, at every circular shift."""
    white = []
    for image in (query, entry):
        spectrum = torch.fft.fft2(image.double())
        white.append(torch.fft.ifft2(spectrum / spectrum.abs()).real)
    best = (-math.inf, 0)
    for i in range(query.shape[0]):
        for j in range(query.shape[1]):
            value = (white[0] * white[1].roll((i, j), dims=(0, 1))).sum().item()
            best = max(best, (value, i))
    return best


@settings(max_examples=25, deadline=None)
@given(st.integers(4, 9), st.integers(3, 8), st.integers(0, 99), st.floats(0, 1))
def test_phase_correlation_against_brute_force(rows, columns, seed, noise):
    entry = maps(rows, columns, seed=seed)
    query = entry.roll((seed % rows, 1), dims=(0, 1)) + noise * maps(rows, columns, seed=seed + 1)
    peak, shift = phase_correlation(query, entry)
    expected, row = peak_by_loop(query, entry)
    assert peak.item() == pytest.approx(expected, abs=1e-4)
    if noise == 0:
        assert shift.item() == row == seed % rows


def test_phase_correlation_finds_the_shift_in_noise_and_broadcasts():
    entries = maps(5, 24, 16)
    shifts = torch.tensor([0, 1, 7, 12, 23])
    queries = torch.stack([e.roll(int(s), 0) for e, s in zip(entries, shifts, strict=True)])
    match = phase_correlation(queries + 0.5 * maps(5, 24, 16, seed=1), entries)
    assert torch.equal(match.shift, shifts)
    pairs = phase_correlation(queries[:, None], entries)
    assert pairs.shift.shape == (5, 5)
    assert torch.equal(pairs.shift.diagonal(), shifts)
    assert torch.equal(pairs.score.argmax(dim=1), torch.arange(5))
    assert torch.allclose(pairs.score.diagonal(), torch.ones(5), atol=1e-5)

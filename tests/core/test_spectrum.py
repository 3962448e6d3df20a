"""Row-wise DFT magnitude: invariance, half-spectrum weights, the 2DFT, the paper's claim."""

import math
from functools import partial

import numpy as np
import pytest
import torch

from deepring.core.correlation import circular_cross_correlation, standardise, unit_norm
from deepring.core.equivariance import (
    assert_invariant,
    assert_tau_invariant,
    assert_theta_equivariant,
    relative_error,
)
from deepring.core.radon import radon
from deepring.core.rigid import turn_points
from deepring.core.spectrum import (
    column_dft_magnitude,
    row_dft_magnitude,
    standardise_spectrum,
)
from deepring.rasters.bev import bev_occupancy
from deepring.rasters.polar import polar_gram
from helpers.scenes import scattered


@pytest.mark.parametrize("bins", [12, 13, 14, 15])
def test_inner_products_equal_those_of_the_full_spectrum(bins):
    a, b = torch.randn(2, 5, bins)
    full = [torch.fft.fft(x, norm="ortho").abs() for x in (a, b)]
    half = [row_dft_magnitude(x) for x in (a, b)]
    assert torch.allclose((half[0] * half[1]).sum(), (full[0] * full[1]).sum(), rtol=1e-5)
    # Without the weights they differ.
    plain = [torch.fft.rfft(x, norm="ortho").abs() for x in (a, b)]
    assert not torch.allclose((plain[0] * plain[1]).sum(), (full[0] * full[1]).sum(), rtol=1e-2)


@pytest.mark.parametrize("bins", [12, 13, 14, 15])
def test_standardising_the_half_is_standardising_the_full_spectrum(bins):
    a, b = torch.rand(2, 5, bins)
    full = [standardise(torch.fft.fft(x, norm="ortho").abs()) for x in (a, b)]
    half = [standardise_spectrum(row_dft_magnitude(x), bins) for x in (a, b)]
    assert torch.allclose((half[0] * half[1]).sum(), (full[0] * full[1]).sum(), atol=1e-3)
    assert torch.allclose((half[0] ** 2).sum(), torch.tensor(5.0 * bins), rtol=1e-4)
    # Standardising the weighted half as it stands is something else.
    naive = [standardise(row_dft_magnitude(x)) for x in (a, b)]
    assert not torch.allclose((naive[0] * naive[1]).sum(), (full[0] * full[1]).sum(), rtol=1e-2)


def test_exact_symmetries():
    x = torch.randn(2, 1, 12, 16)
    assert_tau_invariant(row_dft_magnitude, x, 5)
    assert_theta_equivariant(row_dft_magnitude, x, 3)
    each_row_its_own_shift = [round(6 * math.cos(2 * math.pi * k / 12)) for k in range(12)]

    def translate(t):
        rows = [t[..., k, :].roll(s, -1) for k, s in enumerate(each_row_its_own_shift)]
        return torch.stack(rows, -2)

    assert_invariant(row_dft_magnitude, x, translate)

    def two_dft(t):
        return column_dft_magnitude(row_dft_magnitude(t))

    assert_invariant(two_dft, x, lambda t: translate(t).roll(5, -2))
    with pytest.raises(AssertionError):  # a 2-D DFT alone does not undo a translation
        assert_invariant(lambda t: torch.fft.rfft2(t).abs(), x, translate)


@pytest.mark.parametrize("shape", [(6, 5), (2, 6, 5), (3, 2, 6, 5)])
def test_the_second_dft_is_that_of_its_definition_and_keeps_the_norm(shape):
    x = torch.rand(shape)
    theta = torch.arange(6)
    basis = torch.exp(-2j * math.pi * theta[:, None] * theta / 6) / math.sqrt(6)
    expected = (basis @ x.to(torch.complex64)).abs()
    assert torch.allclose(column_dft_magnitude(x), expected, atol=1e-5)
    assert torch.allclose(column_dft_magnitude(x).norm(), x.norm())


@pytest.mark.parametrize(
    "function",
    [row_dft_magnitude, partial(standardise_spectrum, bins=6), column_dft_magnitude],
)
def test_spectra_stay_on_the_device_of_the_feature(function):
    feature = torch.empty(2, 5, 4, device="meta")  # an accelerator that every machine has
    assert function(feature).device == feature.device


def ring(points):
    return unit_norm(row_dft_magnitude(radon(torch.from_numpy(bev_occupancy(points))[None])))


def polar(points):
    gram = torch.from_numpy(polar_gram(points))[None].float()
    return unit_norm(row_dft_magnitude(gram))


def test_sinogram_keeps_its_spectrum_under_translation_where_the_polar_gram_does_not():
    sg, pg = [], []
    for seed in range(6):
        points = scattered(seed, radius=40.0)
        direction = np.random.default_rng(seed).uniform(0, 2 * np.pi)
        step = 4.0 * np.array([np.cos(direction), np.sin(direction), 0.0], dtype=np.float32)
        moved = turn_points(points + step, 25 * 2 * math.pi / 120)
        for describe, scores in ((ring, sg), (polar, pg)):
            match = circular_cross_correlation(describe(moved), describe(points))
            scores.append(match.score.item())
    print(f"correlation after a 4 m shift: sinogram {np.mean(sg):.3f}, polar {np.mean(pg):.3f}")
    assert np.mean(sg) > 0.98
    assert np.mean(sg) > np.mean(pg) + 0.1


def test_raw_sinogram_spectra_cannot_tell_a_half_turn():
    magnitude = row_dft_magnitude(radon(torch.from_numpy(bev_occupancy(scattered(7)))))
    assert relative_error(magnitude.roll(60, 0), magnitude) < 1e-5

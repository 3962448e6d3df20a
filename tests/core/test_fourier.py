"""Transforms of no scans, of the shapes that those of some have."""

import pytest
import torch

from deepring.core import fourier
from deepring.core.correlation import circular_cross_correlation
from deepring.core.phase import central_magnitude, phase_correlation
from deepring.core.spectrum import column_dft_magnitude, row_dft_magnitude

REAL, COMPLEX = torch.rand(3, 6, 8), torch.rand(3, 6, 5, dtype=torch.complex64)


@pytest.mark.parametrize(
    ("name", "values", "arguments"),
    [
        ("rfft", REAL, {"dim": -2}),
        ("rfft", REAL, {"dim": -1, "norm": "ortho"}),
        ("rfft", REAL[:, :1], {"dim": -1}),
        ("irfft", COMPLEX, {"n": 8, "dim": -1}),
        ("fft", REAL, {"dim": -2}),
        ("fft2", REAL, {"norm": "ortho"}),
        ("rfft2", REAL, {}),
        ("irfft2", COMPLEX, {"s": (6, 8)}),
    ],
)
def test_an_empty_batch_has_the_shape_of_another(name, values, arguments):
    transform, expected = getattr(fourier, name), getattr(torch.fft, name)(values, **arguments)
    assert torch.equal(transform(values, **arguments), expected)
    empty = transform(values[:0], **arguments)
    assert (empty.shape, empty.dtype) == ((0, *expected.shape[1:]), expected.dtype)


@pytest.mark.parametrize("form", ["paper", "published"])
@pytest.mark.parametrize(("q", "d"), [(0, 3), (3, 0), (0, 0)])
def test_the_correlation_of_none(q, d, form):
    score, shift = circular_cross_correlation(REAL[:q], REAL[:d], form)
    assert score.shape == shift.shape == (q, d)


def test_the_magnitudes_of_none():
    assert row_dft_magnitude(REAL[:0]).shape == (0, 6, 5)
    assert column_dft_magnitude(REAL[:0]).shape == (0, 6, 8)
    assert central_magnitude(REAL[:0], 4).shape == (0, 16)
    assert phase_correlation(REAL[0], REAL[:0]).shift.shape == (0,)

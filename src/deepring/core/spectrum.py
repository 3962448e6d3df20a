"""Spectra of rows: magnitudes, which are invariant to translation (paper, Eq. 7), and phases
between directions, which bear a small one."""

from typing import Any

import torch
from jaxtyping import Complex64, Float, Float32
from torch import Tensor

from deepring.core import fourier
from deepring.core.arrays import real_tensor
from deepring.errors import DataError


def row_dft_magnitude(
    feature: Any,
) -> Float32[Tensor, "*batch theta omega"]:
    """|DFT over τ| of each row: (..., θ, τ) real -> (..., θ, τ // 2 + 1), orthonormal.

    A circular shift of a row leaves it unchanged. Only ω >= 0 is kept, since the spectrum of a
    real row is symmetric; the doubled frequencies are weighted by √2, so that inner products and
    norms over this half equal those over the paper's full spectrum.

    >>> row = torch.tensor([[4.0, 0.0, 0.0, 0.0]])
    >>> row_dft_magnitude(row), row_dft_magnitude(row.roll(1, dims=-1))
    (tensor([[2.0000, 2.8284, 2.0000]]), tensor([[2.0000, 2.8284, 2.0000]]))

    Raises DataError for what is nothing like an array (..., θ, τ) of real numbers.
    """
    spectrum, weights = _row_dft(feature)
    return spectrum.abs() * weights


def row_dft(feature: Any) -> Complex64[Tensor, "*batch theta omega"]:
    """DFT over τ of each row: (..., θ, τ) real -> (..., θ, τ // 2 + 1), orthonormal.

    Only ω >= 0 is kept, and the doubled frequencies are weighted by √2; see `row_dft_magnitude`.

    Raises DataError for what is nothing like an array (..., θ, τ) of real numbers.
    """
    spectrum, weights = _row_dft(feature)
    return spectrum * weights


def _row_dft(
    feature: Any,
) -> tuple[Complex64[Tensor, "*batch theta omega"], Float32[Tensor, " omega"]]:
    """The spectra before they are weighted, and the weights of ω."""
    feature = real_tensor("feature", feature)
    if feature.ndim < 1 or not feature.shape[-1]:
        raise DataError(f"feature: shape {tuple(feature.shape)}, expected (..., θ, τ)")
    spectrum = fourier.rfft(feature.float(), dim=-1, norm="ortho")
    return spectrum, _weights(feature.shape[-1]).to(spectrum.device)


def cross_spectrum(
    spectrum: Complex64[Tensor, "*batch theta omega"], gap: int
) -> Complex64[Tensor, "*batch theta omega"]:
    """The phase between directions ``gap`` rows apart: (..., θ, ω) -> the same shape.

    With G = F(θ, ω) F*(θ + gap, ω) of the spectra of `row_dft` it is G / √|G|, whose magnitude is
    that of a spectrum. θ wraps around a full turn.

    A translation by t moves row θ by its projection on the row's direction n(θ) (paper, Eq. 3), and
    so turns the phase of G by ω t·(n(θ) - n(θ + gap)). The two directions are 2 sin(gap / 2) apart,
    so that what `row_dft_magnitude` forgets altogether fades here, the sooner the higher ω: 10 m
    across directions 12° apart are 2.1 m along τ. A shift that all rows share leaves no trace, and
    a turn of the scan rolls the rows.

    >>> rows = torch.tensor([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    >>> pair = cross_spectrum(row_dft(rows), gap=1)
    >>> pair.abs().equal(row_dft(rows).abs()), pair[0, 1].angle() / torch.pi  # a quarter of a turn
    (True, tensor(0.5000))
    """
    pair = spectrum * spectrum.roll(-gap, dims=-2).conj()
    power = pair.real.square() + pair.imag.square()
    return pair * power.clamp_min(1e-12).pow(-0.25)


def _weights(bins: int) -> Float32[Tensor, " {bins}//2+1"]:
    """Square root of how often each ω >= 0 occurs in the spectrum of ``bins`` real values."""
    weight = torch.full((bins // 2 + 1,), 2.0**0.5)
    weight[0] = 1.0
    if bins % 2 == 0:
        weight[-1] = 1.0
    return weight


def standardise_spectrum(
    magnitude: Float[Tensor, "*batch theta omega"], bins: int
) -> Float[Tensor, "*batch theta omega"]:
    """Zero mean and unit deviation over the full spectrum that `row_dft_magnitude` halves.

    (..., θ, ω) of rows of ``bins`` values -> the same shape. Inner products over the result
    equal those of the standardised full spectrum (RING, lus6-Jenny/RING), whose mean and
    deviation differ from those of the weighted half.

    >>> rows = torch.tensor([[4.0, 0.0, 2.0], [1.0, 3.0, 0.0]])
    >>> standard = standardise_spectrum(row_dft_magnitude(rows), bins=3)
    >>> round(float(standard.square().sum()), 4)  # deviation 1 over 2 x 3 values
    6.0
    """
    weight = _weights(bins).to(magnitude.device)
    size = magnitude.shape[-2] * bins
    mean = (magnitude * weight).sum(dim=(-2, -1), keepdim=True) / size
    centred = magnitude - mean * weight
    deviation = (centred.square().sum(dim=(-2, -1), keepdim=True) / size).sqrt()
    return centred / deviation.clamp_min(1e-12)


def column_dft_magnitude(
    magnitude: Float[Tensor, "*batch theta omega"],
) -> Float32[Tensor, "*batch theta omega"]:
    """|DFT over θ| of a row magnitude, (..., θ, ω) -> (..., θ, ω): the second DFT of the 2DFT.

    A circular shift of the rows, i.e. a turn of the scan, leaves it unchanged, so that L2
    compares descriptors without a search (paper, Sec. VI-D, "Loss"). It takes the row-wise
    magnitude: a 2-D DFT of the feature itself would not be invariant to a translation, whose
    shift in τ differs from row to row.

    >>> rows = torch.tensor([[3.0], [1.0], [0.0], [0.0]])
    >>> column_dft_magnitude(rows).equal(column_dft_magnitude(rows.roll(1, dims=-2)))
    True
    """
    return fourier.fft(magnitude.float(), dim=-2, norm="ortho").abs()

"""Magnitude spectra: translation (and rotation) leave through the phase (paper, Eq. 7)."""

import torch
from torch import Tensor


def row_dft_magnitude(feature: Tensor) -> Tensor:
    """|DFT over τ| of each row: (..., θ, τ) real -> (..., θ, τ // 2 + 1), orthonormal.

    A circular shift of a row leaves it unchanged. Only ω >= 0 is kept, since the spectrum of a
    real row is symmetric; the doubled frequencies are weighed by √2, so that inner products and
    norms over this half equal those over the paper's full spectrum.
    """
    magnitude = torch.fft.rfft(feature.float(), dim=-1, norm="ortho").abs()
    weight = magnitude.new_full((magnitude.shape[-1],), 2.0**0.5)
    weight[0] = 1.0
    if feature.shape[-1] % 2 == 0:
        weight[-1] = 1.0
    return magnitude * weight


def column_dft_magnitude(magnitude: Tensor) -> Tensor:
    """|DFT over θ| of a row magnitude, (..., θ, ω) -> (..., θ, ω): the second DFT of the 2DFT.

    A circular shift of the rows, that is a turn of the scan, leaves it unchanged, so that L2
    compares descriptors without a search (paper, Sec. VI-D, "Loss"). It follows the row-wise
    magnitude: a 2-D DFT of the feature itself would not undo a translation, whose shift in τ
    differs from row to row.
    """
    return torch.fft.fft(magnitude.float(), dim=-2, norm="ortho").abs()

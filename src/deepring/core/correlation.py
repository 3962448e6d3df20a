"""Circular cross-correlation over θ and its maximum: how alike two places are (paper, Eq. 8)."""

import math
from typing import NamedTuple

import torch
from torch import Tensor


class Match(NamedTuple):
    """The best alignment of each query with each database entry."""

    score: Tensor
    """(q, d) correlation at the best shift."""
    shift: Tensor
    """(q, d) int64, rows: the query is the entry's rows rolled by +shift."""


def theta_spectrum(descriptor: Tensor) -> Tensor:
    """DFT over θ of descriptors (n, θ, ω), complex64 (n, θ // 2 + 1, ω): what a search stores."""
    return torch.fft.rfft(descriptor.float(), dim=-2)


def correlation_curves(queries: Tensor, database: Tensor) -> Tensor:
    """C(α) = Σ_θ Σ_ω Q(θ + α, ω) D(θ, ω) for all pairs and shifts: (q, d, θ).

    By the correlation theorem: one complex product over ω for each θ-frequency, and one inverse
    transform a pair, after the sum over ω.

    Args:
        queries: (q, θ, ω) real.
        database: (d, θ, ω) real.
    """
    rows = queries.shape[-2]
    q = theta_spectrum(queries).permute(1, 0, 2)
    d = theta_spectrum(database).permute(1, 2, 0)
    cross = torch.bmm(q, d.conj())
    return torch.fft.irfft(cross.permute(1, 2, 0), n=rows, dim=-1)


def circular_cross_correlation(queries: Tensor, database: Tensor) -> Match:
    """The largest correlation over all circular shifts, and that shift, for all pairs (q, d)."""
    return Match(*correlation_curves(queries, database).max(dim=-1))


def shift_to_yaw(shift: Tensor, rows: int, period: float = 2 * math.pi) -> Tensor:
    """Rows to the turn of the points, radians in [-period/2, period/2): entry -> query.

    Counter-clockwise. ``period`` is the range of θ that the rows span.
    """
    turn = shift.to(torch.float32) * (period / rows)
    return torch.remainder(turn + period / 2, period) - period / 2


def standardise(descriptor: Tensor) -> Tensor:
    """Zero mean and unit deviation over each map's last two axes; correlations are then sums."""
    centred = descriptor - descriptor.mean(dim=(-2, -1), keepdim=True)
    deviation = centred.square().mean(dim=(-2, -1), keepdim=True).sqrt()
    return centred / deviation.clamp_min(1e-12)


def unit_norm(descriptor: Tensor) -> Tensor:
    """Unit Euclidean norm over each map's last two axes; correlations lie in [-1, 1]."""
    norm = descriptor.square().sum(dim=(-2, -1), keepdim=True).sqrt()
    return descriptor / norm.clamp_min(1e-12)

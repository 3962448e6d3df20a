"""Circular cross-correlation over θ and its maximum, the similarity of places (paper, Eq. 8)."""

import math
from typing import Any, Literal, NamedTuple

import torch
from jaxtyping import Complex64, Float, Float32, Int64
from torch import Tensor

from deepring.checks import one_of
from deepring.core import fourier
from deepring.core.arrays import real_tensor
from deepring.errors import DataError

Form = Literal["paper", "published"]
"""Eq. 8 of the paper, or the correlation of the authors' code (lus6-Jenny/RING)."""

#: Cells (pair, θ, ω) that `magnitude_correlation_curves` holds at once: 16 MiB of float32.
BLOCK = 2**22


class Match(NamedTuple):
    """The best alignment of each query with each database entry."""

    score: Float32[Tensor, "*pairs"]
    """(q, d) correlation at the best shift."""
    shift: Int64[Tensor, "*pairs"]
    """(q, d) int64, rows: the query is the entry's rows rolled by +shift."""


def theta_spectrum(
    descriptor: Float[Tensor, "n theta omega"],
) -> Complex64[Tensor, "n theta//2+1 omega"]:
    """DFT over θ of descriptors (n, θ, ω), complex64 (n, θ // 2 + 1, ω), as an index stores it.

    >>> theta_spectrum(torch.ones(1, 4, 2))[0, :, 0]
    tensor([4.+0.j, 0.+0.j, 0.+0.j])
    """
    return fourier.rfft(descriptor.float(), dim=-2)


def correlation_curves(
    queries: Float[Tensor, "q theta omega"], database: Float[Tensor, "d theta omega"]
) -> Float32[Tensor, "q d theta"]:
    """C(α) = Σ_θ Σ_ω Q(θ + α, ω) D(θ, ω) for all pairs and shifts: (q, d, θ).

    By the correlation theorem: one complex product over ω per θ-frequency, and one inverse
    transform per pair, after the sum over ω.

    Args:
        queries: (q, θ, ω) real.
        database: (d, θ, ω) real.

    >>> place = torch.tensor([[[2.0], [1.0], [0.0], [0.0]]])
    >>> correlation_curves(place.roll(1, dims=-2), place).round().int().tolist()
    [[[2, 5, 2, 0]]]
    """
    rows = queries.shape[-2]
    q = theta_spectrum(queries).permute(1, 0, 2)
    d = theta_spectrum(database).permute(1, 2, 0)
    cross = torch.bmm(q, d.conj())
    return fourier.irfft(cross.permute(1, 2, 0), n=rows, dim=-1)


def magnitude_correlation_curves(
    queries: Float[Tensor, "q theta omega"], database: Float[Tensor, "d theta omega"]
) -> Float32[Tensor, "q d theta"]:
    """C(α) = Σ_ω |Σ_θ Q(θ + α, ω) D(θ, ω)| for all pairs and shifts: (q, d, θ), at least 0.

    ``fast_corr`` and ``circorr2`` of the published code (lus6-Jenny/RING) take the inverse
    transform of each ω, and its magnitude before the sum over ω, where Eq. 8 sums signed values:
    a frequency with rows of opposite sign raises the score. The sum is over the full spectrum:
    the half of `row_dft_magnitude` carries √2 on doubled frequencies in each factor, hence 2 in
    their product, and ω and -ω have the same curve. Constant factors of the code are left out.

    A pair needs ω inverse transforms instead of one. Pairs are computed in blocks of `BLOCK` cells
    (pair, θ, ω), at least one pair, which bounds the memory for any number of pairs.

    Args:
        queries: (q, θ, ω) real.
        database: (d, θ, ω) real.

    >>> place = torch.tensor([[[2.0], [-1.0], [0.0], [0.0]]])
    >>> magnitude_correlation_curves(place, place).round().int().tolist()
    [[[5, 2, 0, 2]]]
    """
    rows, width = queries.shape[-2:]
    pairs = max(1, BLOCK // (rows * width))
    entries = torch.split(theta_spectrum(database).conj(), pairs)
    batches = torch.split(theta_spectrum(queries), max(1, pairs // max(1, len(database))))

    def curves(
        q: Complex64[Tensor, "q frequency omega"], d: Complex64[Tensor, "d frequency omega"]
    ) -> Float32[Tensor, "q d theta"]:
        return fourier.irfft(q[:, None] * d, n=rows, dim=-2).abs().sum(dim=-1)

    return torch.cat([torch.cat([curves(q, d) for d in entries], dim=1) for q in batches])


def circular_cross_correlation(queries: Any, database: Any, form: Form = "paper") -> Match:
    """The largest correlation over all circular shifts, and that shift, for all pairs (q, d).

    Descriptors are (q, θ, ω) and (d, θ, ω): tensors, or anything like arrays of real numbers.

    >>> place = torch.tensor([[[2.0], [1.0], [0.0], [0.0]]])
    >>> circular_cross_correlation(place.roll(1, dims=-2), place).shift
    tensor([[1]])

    Raises DataError for anything else, and for descriptors of different shapes.
    """
    queries, database = real_tensor("queries", queries), real_tensor("database", database)
    sizes = queries.shape[1:], database.shape[1:]
    if queries.ndim != 3 or sizes[0] != sizes[1] or not all(sizes[0]):
        raise DataError(
            f"queries {tuple(queries.shape)}, database {tuple(database.shape)}: expected (q, θ, ω) "
            "and (d, θ, ω) with the same θ and ω, of at least 1"
        )
    if not (queries.is_floating_point() and database.is_floating_point()):
        queries, database = queries.float(), database.float()
    one_of("form", form, Form)
    curves = correlation_curves if form == "paper" else magnitude_correlation_curves
    return Match(*curves(queries, database).max(dim=-1))


def shift_to_turn(
    shift: Int64[Tensor, "*pairs"], rows: int, period: float = 2 * math.pi
) -> Float32[Tensor, "*pairs"]:
    """Turn of the points from entry to query for shifts in rows, radians in [-period/2, period/2).

    Counter-clockwise. ``period`` is the range of θ that the rows span.

    >>> shift_to_turn(torch.tensor([0, 1, 3]), rows=4)
    tensor([ 0.0000,  1.5708, -1.5708])
    """
    turn = shift.to(torch.float32) * (period / rows)
    return torch.remainder(turn + period / 2, period) - period / 2


def standardise(
    descriptor: Float[Tensor, "*batch theta omega"],
) -> Float[Tensor, "*batch theta omega"]:
    """Zero mean and unit deviation over each map's last two axes; correlations are then sums.

    >>> standardise(torch.tensor([[1.0, 3.0]]))
    tensor([[-1.,  1.]])
    """
    centred = descriptor - descriptor.mean(dim=(-2, -1), keepdim=True)
    variance = centred.square().mean(dim=(-2, -1), keepdim=True)
    return centred / variance.clamp_min(1e-24).sqrt()  # of 0 the root has no gradient


def unit_norm(
    descriptor: Float[Tensor, "*batch theta omega"],
) -> Float[Tensor, "*batch theta omega"]:
    """Unit Euclidean norm over each map's last two axes; correlations lie in [-1, 1].

    >>> unit_norm(torch.tensor([[3.0, 4.0]]))
    tensor([[0.6000, 0.8000]])
    """
    power = descriptor.square().sum(dim=(-2, -1), keepdim=True)
    return descriptor / power.clamp_min(1e-24).sqrt()  # of 0 the root has no gradient

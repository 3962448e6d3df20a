"""The pose of one scan in another's frame from their sinograms, row by row (as RING has it).

A translation (x, y) shifts the row of direction θ by x cos θ + y sin θ. Each row's shift is the
peak of a correlation; two unknowns are fitted to all of them robustly. `deepring.core.alignment`
correlates whole images and holds better; this is the way of the sinogram's family.
"""

import math

import torch
from torch import Tensor

from deepring.core.alignment import Alignment
from deepring.errors import DeepringError

#: Reweighted least squares: rounds, and the residual in bins beyond which a row counts less.
_ROUNDS, _INLIER = 10, 1.5


def align_rows(query: Tensor, maps: Tensor, yaws: Tensor, extent: float = 70.0) -> Alignment:
    """Align one query with n map scans.

    Args:
        query: (θ, τ) sinogram over a full turn.
        maps: (n, θ, τ) sinograms.
        yaws: (n, y) radians to try, rounded to whole rows: turns of the points from map scan to
            query.
        extent: half the range of τ, metres.

    Returns:
        The alignment; its score is the mean correlation of the rows at the shifts of the fit, at
        most 1.
    """
    if query.ndim != 2 or maps.shape[1:] != query.shape:
        raise DeepringError(
            f"maps: shape {tuple(maps.shape)}, query: {tuple(query.shape)}; expected (n, θ, τ) and "
            "(θ, τ) of one size"
        )
    rows, bins = query.shape
    turns = (yaws * rows / (2 * math.pi)).round().long()
    back = (torch.arange(rows, device=query.device) + turns[..., None]) % rows
    curves = _row_correlation(query[back], maps[:, None])  # (n, y, θ, 2 bins), middle at bins
    theta = torch.arange(rows, device=query.device) * (2 * math.pi / rows)
    directions = torch.stack([theta.cos(), theta.sin()], dim=-1)
    shift = _fit(curves.argmax(dim=-1).float() - bins, directions)  # (n, y, 2) bins
    at = ((shift @ directions.T).round().long() + bins).clamp(0, 2 * bins - 1)
    score = curves.gather(-1, at[..., None])[..., 0].mean(dim=-1)  # (n, y)
    which = score.argmax(dim=-1)
    every = torch.arange(len(maps), device=query.device)
    yaw = turns[every, which] * (2 * math.pi / rows)
    wrapped = torch.remainder(yaw + math.pi, 2 * math.pi) - math.pi
    position = shift[every, which] * (2 * extent / bins)
    return Alignment(score[every, which], wrapped, position)


def _row_correlation(query: Tensor, maps: Tensor) -> Tensor:
    """Half-whitened correlation of each row over shifts of τ: (..., θ, 2 τ), 0 in the middle."""
    bins = query.shape[-1]
    product = _half_whitened(maps) * _half_whitened(query).conj()
    curves = torch.fft.irfft(product, n=2 * bins) * 2 * bins
    return curves.roll(bins, dims=-1)


def _half_whitened(rows: Tensor) -> Tensor:
    """Spectra of the rows, padded to twice their length, of unit norm over all frequencies."""
    spectrum = torch.fft.rfft(rows, n=2 * rows.shape[-1])
    spectrum[..., 0] = 0
    size = spectrum.abs()
    power = 2 * size.sum(dim=-1, keepdim=True) - size[..., -1:]
    return spectrum / size.sqrt().clamp_min(1e-12) / power.sqrt().clamp_min(1e-12)


def _fit(shifts: Tensor, directions: Tensor) -> Tensor:
    """(..., 2) that explains shifts (..., θ) along directions (θ, 2), rows that do not fit
    counting less and less (Cauchy weights)."""
    weight = torch.ones_like(shifts)
    solution = shifts.new_zeros(*shifts.shape[:-1], 2)
    for k in range(_ROUNDS):
        normal = torch.einsum("...t,ti,tj->...ij", weight, directions, directions)
        right = torch.einsum("...t,...t,ti->...i", weight, shifts, directions)
        solution = torch.linalg.solve(normal + 1e-6 * torch.eye(2, device=shifts.device), right)
        residual = (shifts - solution @ directions.T) / (_INLIER * 2 ** max(0, 4 - k))
        weight = 1 / (1 + residual.square())
    return solution

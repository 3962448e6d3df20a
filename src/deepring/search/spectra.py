"""θ-spectra of descriptors as an index stores them, and their correlation with queries (Eq. 8).

The correlation over rotations is one product per θ-frequency, summed over ω, and one inverse
transform after the sum. The index therefore stores the DFT over θ instead of the descriptor.
"""

import math
from functools import lru_cache
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float, Float32, Int64, Shaped
from torch import Tensor

from deepring.core import fourier
from deepring.core.correlation import theta_spectrum

Precision = Literal["float32", "bfloat16", "int8"]
"""Type of the stored numbers. int8 has one scale per place and θ-frequency."""

#: ω is padded with zeros to a multiple of this number, so that compiled loops have no remainder.
LANES = 16

#: Frequencies between two checks of the compiled search whether a place can still be the best.
TAIL_STEP = 8


class Spectra(NamedTuple):
    """θ-spectra of n places, θ // 2 + 1 = k frequencies of w values of ω."""

    values: Shaped[Tensor, "n k 2 w"]
    """(n, k, 2, w) real and imaginary parts, w padded with zeros."""
    scale: Float32[Tensor, "n k"]
    """(n, k) float32: factor of the values of each frequency."""
    tails: Float32[Tensor, "n c"]
    """(n, c) float32: norms of the frequencies from 8, 16, ... on, see `tail_norms`."""


def padded_spectra(
    descriptors: Float[Tensor, "n theta omega"],
) -> Float32[Tensor, "n theta//2+1 2 w"]:
    """θ-spectra (n, k, 2, w) float32 of descriptors (n, θ, ω): real and imaginary parts.

    w is ω, padded with zeros to a multiple of `LANES`.
    """
    spectrum = torch.view_as_real(theta_spectrum(descriptors)).transpose(-1, -2)
    padding = -spectrum.shape[-1] % LANES
    return torch.nn.functional.pad(spectrum, (0, padding)).contiguous()


def encode(descriptors: Float[Tensor, "n theta omega"], precision: Precision) -> Spectra:
    """Spectra of descriptors (n, θ, ω) for storage in an index."""
    spectra = padded_spectra(descriptors)
    scale = torch.ones(spectra.shape[:2], device=spectra.device)
    if precision == "int8":
        scale = spectra.abs().amax(dim=(-2, -1)).clamp_min(1e-30) / 127
    values = spectra / scale[..., None, None]
    values = (values.round() if precision == "int8" else values).to(getattr(torch, precision))
    decoded = values.float() * scale[..., None, None]
    return Spectra(values, scale, tail_norms(decoded, descriptors.shape[1]))


def decode(spectra: Spectra, shape: tuple[int, int]) -> Float32[Tensor, "n theta omega"]:
    """Descriptors (n, θ, ω) of a ``shape`` (θ, ω), as precisely as their spectra were stored."""
    rows, columns = shape
    values = spectra.values[..., :columns].float() * spectra.scale[..., None, None]
    parts = torch.view_as_complex(values.transpose(-1, -2).contiguous())
    return fourier.irfft(parts, n=rows, dim=1)


def tail_norms(spectra: Float32[Tensor, "n k 2 w"], rows: int) -> Float32[Tensor, "n c"]:
    """Norms (n, c) of the spectra (n, k, 2, w) from frequency 8, 16, ... on.

    The frequencies from there on add at most the product of two spectra's norms to a correlation
    at any rotation (Cauchy-Schwarz). They are weighted as in the inverse DFT.
    """
    weight = idft_basis(rows)[0, :, 0].to(spectra.device)
    energy = spectra.square().sum(dim=(-2, -1)) * weight
    return energy.flip(1).cumsum(dim=1).flip(1)[:, TAIL_STEP::TAIL_STEP].sqrt().contiguous()


def best_shift(
    queries: Float32[Tensor, "q k 2 w"], places: Spectra, rows: int
) -> tuple[Float32[Tensor, "q n"], Int64[Tensor, "q n"]]:
    """The largest correlation (q, n) over all circular shifts of θ, and that shift, int64.

    In plain torch, on the device of the places.

    Args:
        queries: (q, k, 2, w) float32, from `padded_spectra`.
        places: spectra of n places.
        rows: rows θ of the descriptors.
    """
    cross = cross_spectra(queries, places)
    curves = fourier.irfft(torch.view_as_complex(cross), n=rows, dim=-1)
    best = curves.max(dim=-1)
    return best.values, best.indices


def cross_spectra(
    queries: Float32[Tensor, "q k 2 w"], places: Spectra
) -> Float32[Tensor, "q n k 2"]:
    """Σ_ω Q(k, ω) conj D(k, ω) for all pairs, real and imaginary parts: (q, n, k, 2) float32.

    One real matrix product per frequency: rows (Re, Im) and (Im, -Re) of Q on columns of D.
    """
    values = places.values
    real, imaginary = queries.unbind(dim=2)  # (q, k, w)
    rows = torch.stack(
        [torch.cat([real, imaginary], dim=-1), torch.cat([imaginary, -real], dim=-1)], dim=2
    )
    rows = rows.permute(1, 0, 2, 3).flatten(1, 2)  # (k, 2q, 2w)
    columns = values.flatten(2).permute(1, 2, 0)  # (k, 2w, n)
    if values.dtype != torch.bfloat16 or values.device.type == "cpu":
        columns = columns.float()
    product = torch.bmm(rows.to(columns.dtype), columns).float()  # (k, 2q, n)
    cross = product.view(len(product), -1, 2, len(values)).permute(1, 3, 0, 2)
    return (cross * places.scale[None, :, :, None]).contiguous()


@lru_cache
@torch.inference_mode(False)
def idft_basis(rows: int) -> Float32[Tensor, "2 {rows}//2+1 {rows}"]:
    """Weighted cosines and sines (2, k, θ) of the inverse DFT of ``rows`` real values."""
    frequency = torch.arange(rows // 2 + 1, dtype=torch.float64)
    # Frequencies except 0 and θ / 2 occur twice in the full spectrum.
    single = (frequency == 0) | (2 * frequency == rows)
    weight = torch.where(single, 1.0, 2.0) / rows
    angle = 2 * math.pi / rows * frequency[:, None] * torch.arange(rows)
    return (weight[:, None] * torch.stack([angle.cos(), angle.sin()])).float()

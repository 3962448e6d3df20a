"""θ-spectra of descriptors as a map keeps them, and their correlation with queries (Eq. 8).

Correlating over rotations is a product for each θ-frequency, summed over ω, and one inverse
transform after the sum. The DFT over θ of what does not change is therefore kept, not the
descriptor.
"""

from typing import Literal, NamedTuple, get_args

import torch
from torch import Tensor

from deepring.core.correlation import theta_spectrum
from deepring.errors import DeepringError

Precision = Literal["float32", "bfloat16", "int8"]
"""How a number of a spectrum is kept. int8 has a scale for each place and θ-frequency."""

#: ω is padded with zeros to a multiple of this, so that compiled loops have no remainder.
LANES = 16


class Spectra(NamedTuple):
    """θ-spectra of n places, θ // 2 + 1 = k frequencies of w values of ω."""

    values: Tensor
    """(n, k, 2, w) real and imaginary parts, w padded with zeros."""
    scale: Tensor
    """(n, k) float32: what each frequency's values are to be multiplied by."""


def expect_precision(name: str, precision: str) -> None:
    """Raise DeepringError where ``precision`` is no `Precision`."""
    if precision not in get_args(Precision):
        raise DeepringError(f"{name}: {precision!r}, expected one of {get_args(Precision)}")


def spectrum_planes(descriptors: Tensor) -> Tensor:
    """θ-spectra (n, k, 2, w) float32 of descriptors (n, θ, ω)."""
    spectrum = torch.view_as_real(theta_spectrum(descriptors)).transpose(-1, -2)
    padding = -spectrum.shape[-1] % LANES
    return torch.nn.functional.pad(spectrum, (0, padding)).contiguous()


def encode(descriptors: Tensor, precision: Precision) -> Spectra:
    """What a map keeps of descriptors (n, θ, ω)."""
    planes = spectrum_planes(descriptors)
    scale = torch.ones(planes.shape[:2], device=planes.device)
    if precision == "int8":
        scale = planes.abs().amax(dim=(-2, -1)).clamp_min(1e-30) / 127
        return Spectra((planes / scale[..., None, None]).round().to(torch.int8), scale)
    return Spectra(planes.to(getattr(torch, precision)), scale)


def best_shift(queries: Tensor, places: Spectra, rows: int) -> tuple[Tensor, Tensor]:
    """The largest correlation (q, n) over all circular shifts of θ, and that shift, int64.

    Args:
        queries: (q, k, 2, w) float32, from `spectrum_planes`.
        places: n of them.
        rows: θ of the descriptors.
    """
    cross = cross_spectra(queries, places)
    curves = torch.fft.irfft(torch.view_as_complex(cross), n=rows, dim=-1)
    best = curves.max(dim=-1)
    return best.values, best.indices


def cross_spectra(queries: Tensor, places: Spectra) -> Tensor:
    """Σ_ω Q(k, ω) conj D(k, ω), (q, n, k, 2) float32: compiled on a CPU, else a torch product."""
    compiled = queries.device.type == "cpu"
    cross = (_compiled if compiled else _batched)(queries, places.values)
    if places.values.dtype == torch.int8:
        cross *= places.scale[None, :, :, None]
    return cross


def _compiled(queries: Tensor, values: Tensor) -> Tensor:
    from deepring.search import _kernels

    out = torch.empty(len(queries), *values.shape[:2], 2)
    q, result = queries.contiguous().numpy(), out.numpy()
    if values.dtype == torch.bfloat16:
        bits = values.view(torch.int16).numpy().view("uint16")
        _kernels.cross_spectra_bfloat16(q, bits, result)
    else:
        _kernels.cross_spectra(q, values.numpy(), result)
    return out


def _batched(queries: Tensor, values: Tensor) -> Tensor:
    """One real matrix product a frequency: rows (Re, Im) and (Im, -Re) of Q on columns of D."""
    real, imaginary = queries.unbind(dim=2)  # (q, k, w)
    rows = torch.stack(
        [torch.cat([real, imaginary], dim=-1), torch.cat([imaginary, -real], dim=-1)], dim=2
    )
    left = rows.permute(1, 0, 2, 3).flatten(1, 2)  # (k, 2q, 2w)
    right = values.flatten(2).permute(1, 2, 0)  # (k, 2w, n)
    if values.dtype != torch.bfloat16 or values.device.type == "cpu":
        right = right.float()
    product = torch.bmm(left.to(right.dtype), right).float()  # (k, 2q, n)
    return product.view(len(product), -1, 2, product.shape[-1]).permute(1, 3, 0, 2).contiguous()

"""DiSCO's counterpart of Eq. 7 and 8: the 2-D spectrum of a polar map, and phase correlation.

Source: Xu et al. (RA-L 2021, Sec. III); MaverickPeter/DiSCO-pytorch.
"""

import torch
from jaxtyping import Float, Float32
from torch import Tensor

from deepring.core import fourier
from deepring.core.correlation import Match

#: Added under the root, so that the gradient is finite where a spectrum is zero.
EPSILON = 1e-15


def central_magnitude(
    feature: Float[Tensor, "*batch theta r"], size: int = 32
) -> Float32[Tensor, "*batch {size*size}"]:
    """|2-D DFT| around frequency zero, (..., θ, r) real -> (..., size * size) float32.

    Orthonormal, shifted so that frequency zero lies in the middle, and cut to the ``size`` lowest
    frequencies of either axis, which must have that many. Circular shifts along θ and along r
    leave it unchanged. As the map is real, nearly every value occurs twice.

    >>> central_magnitude(torch.ones(4, 4), size=2).round()
    tensor([0., 0., 0., 4.])
    """
    spectrum = fourier.fft2(feature.float(), norm="ortho")
    magnitude = (spectrum.real.square() + spectrum.imag.square() + EPSILON).sqrt()
    centred = torch.fft.fftshift(magnitude, dim=(-2, -1))
    row, column = (length // 2 - size // 2 for length in feature.shape[-2:])
    return centred[..., row : row + size, column : column + size].flatten(-2)


def phase_curves(
    queries: Float[Tensor, "*#batch theta r"], entries: Float[Tensor, "*#batch theta r"]
) -> Float32[Tensor, "... theta r"]:
    """The phase correlation of maps (..., θ, r) at all shifts along both axes: (..., θ, r).

    The leading axes broadcast. Shifts are those of `Match`: the query is the entry rolled.

    >>> feature = torch.tensor([[3.0, 1.0], [0.0, 5.0]])
    >>> phase_curves(feature.roll(1, dims=-2), feature).round().int().tolist()
    [[0, 0], [1, 0]]
    """
    q, d = (fourier.rfft2(maps.float()) for maps in (queries, entries))
    cross = q * d.conj()
    phase = cross / cross.abs().clamp_min(1e-12)
    return fourier.irfft2(phase, s=queries.shape[-2:])


def phase_correlation(
    queries: Float[Tensor, "*#batch theta r"], entries: Float[Tensor, "*#batch theta r"]
) -> Match:
    """The peak of the phase correlation of maps (..., θ, r), and its shift along θ: (...).

    The leading axes broadcast. The peak is sought over shifts along both axes, as published, and
    is 1 for maps that are circular shifts of each other. The shift is that of `Match`: the query
    is the entry's rows rolled by +shift.

    >>> feature = torch.tensor([[3.0, 1.0], [0.0, 5.0], [2.0, 2.0]])
    >>> phase_correlation(feature.roll(2, dims=-2), feature).shift
    tensor(2)
    """
    curves = phase_curves(queries, entries)
    columns = queries.shape[-1]
    peak, where = curves.flatten(-2).max(dim=-1)
    return Match(peak, torch.div(where, columns, rounding_mode="floor"))

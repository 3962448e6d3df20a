"""The bits of LiDAR-Iris: signs of log-Gabor responses along the azimuth (Wang et al. 2020).

A code is three sets of bits for each sector, one bit for each scale and ring: whether the real part
of the response is positive, whether the imaginary part is, and whether the response is large enough
for these to count.
"""

import math
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Float64, Int32, Shaped
from torch import Tensor

from deepring.core import fourier
from deepring.errors import DataError

#: The filters: number of scales, shortest wavelength in sectors, factor between wavelengths, and
#: the ratio of a filter's spread to its centre.
SCALES, SHORTEST, FACTOR, SPREAD = 4, 18.0, 1.6, 0.75

#: Responses below this count for nothing. They are those of an inverse DFT without a factor.
LEAST = 1e-4

#: Parts of a response above this are positive: one that is zero must not get a sign by rounding.
_ZERO = 1e-9

#: Bits are padded to whole words of this many.
WORD = 64

#: Bits in a number of a descriptor, which float32 holds exactly.
SHARE = 16


class IrisCode(NamedTuple):
    """Bits (b, θ, scales x rings) of responses."""

    real: Bool[Tensor, "batch theta bit"]
    imaginary: Bool[Tensor, "batch theta bit"]
    counts: Bool[Tensor, "batch theta bit"]


def log_gabor(sectors: int = 360) -> Float64[Tensor, "scale frequency"]:
    """G(k) = exp(-ln²(k λ / sectors) / (2 ln² 0.75)) of each wavelength λ, and G(0) = 0.

    Frequencies are k = 0 to sectors // 2; at negative ones the filters are 0.

    >>> log_gabor().sum(dim=1).round(decimals=3).tolist()
    [15.032, 9.395, 5.872, 3.67]
    """
    wavelength = SHORTEST * FACTOR ** torch.arange(SCALES, dtype=torch.float64)
    frequency = torch.arange(sectors // 2 + 1, dtype=torch.float64)
    ratio = wavelength[:, None] * frequency / sectors
    filters = torch.exp(-ratio.log().square() / (2 * math.log(SPREAD) ** 2))
    filters[:, 0] = 0.0
    return filters


def iris_code(images: Shaped[Tensor, "batch theta r"]) -> IrisCode:
    """The code of images (b, θ, r): that of rolled rows is rolled.

    In float64: the least response that counts is a billionth of the largest.
    """
    sectors = images.shape[-2]
    filters = log_gabor(sectors).to(images.device)
    spectrum = fourier.rfft(images.double(), dim=-2)
    filtered = spectrum[:, None] * filters[:, :, None]  # (b, scale, frequency, r)
    response = fourier.ifft(filtered, n=sectors, dim=-2, norm="forward")
    response = response.transpose(1, 2).flatten(2)  # (b, θ, scale r)
    return IrisCode(response.real > _ZERO, response.imag > _ZERO, response.abs() >= LEAST)


def packed(code: IrisCode) -> Float[Tensor, "batch theta number"]:
    """The three parts of a code after each other, `SHARE` bits in a whole number, float32.

    Each part is padded by zeros to whole words of `WORD` bits.
    """
    values = 2 ** torch.arange(SHARE, device=code.real.device)
    parts = []
    for bits in code:
        spare = -bits.shape[-1] % WORD
        whole = torch.nn.functional.pad(bits.to(torch.uint8), (0, spare))
        groups = whole.view(*whole.shape[:-1], whole.shape[-1] // SHARE, SHARE)
        parts.append((groups * values).sum(dim=-1))
    return torch.cat(parts, dim=-1).float()


def unpacked(descriptors: Float[Tensor, "batch theta number"]) -> IrisCode:
    """The code that was `packed`, with the padding, which does not count.

    Raises DataError for numbers that no code has.
    """
    values = 2 ** torch.arange(SHARE, device=descriptors.device)
    bits = (whole_numbers(descriptors)[..., None] & values).bool().flatten(-2)
    return IrisCode(*bits.chunk(3, dim=-1))


def whole_numbers(descriptors: Float[Tensor, "*batch number"]) -> Int32[Tensor, "*batch number"]:
    """The numbers of packed codes as int32. Raises DataError for others."""
    numbers = descriptors.clamp(0, 2**SHARE - 1).to(torch.int32)
    if not torch.equal(numbers.to(descriptors.dtype), descriptors):
        raise DataError(
            f"descriptors: numbers from {float(descriptors.min()):g} to "
            f"{float(descriptors.max()):g}, expected whole ones from 0 to {2**SHARE - 1}, the bits "
            "of LiDAR-Iris; describe the scans by LidarIris"
        )
    return numbers


def packed_length(rings: int) -> int:
    """Numbers per sector of a packed code."""
    return 3 * math.ceil(SCALES * rings / WORD) * (WORD // SHARE)

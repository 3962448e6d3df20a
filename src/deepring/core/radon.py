"""The Radon transform of an image: its sinogram R_f(θ, τ) (paper, Eq. 1 to 3).

By Eq. 2 a turn of the image shifts θ, by Eq. 3 a translation shifts each row along τ.
Pixel-driven with linear interpolation: every occupied cell is projected to
τ = x cos θ + y sin θ and shared between the two nearest τ bins. The cost grows with the
occupied cells only. θ = 2π k / angles without the end point; τ bins are centred on zero.
"""

import math
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import torch
from jaxtyping import Float, Float32, Shaped
from torch import Tensor

from deepring import checks
from deepring.core.arrays import real_tensor
from deepring.errors import ConfigError, DataError

ThetaRange = Literal["full", "half"]
"""The range of θ: [0, 2π), or [0, π), after which rows repeat flipped, R(θ + π, τ) = R(θ, -τ)."""


def radon(
    image: Any,
    angles: int = 120,
    bins: int | None = None,
    extent: float = 1.0,
    theta_range: ThetaRange = "full",
) -> Float32[Tensor, "*batch {angles} tau"]:
    """Sinogram (..., angles, bins) float32 of images (..., n, n) indexed [x, y].

    Values are line integrals in the unit of ``extent`` (half the image's side). A turn of the
    image by +2π k / angles (counter-clockwise) shifts the rows by +k; R(θ + π, τ) = R(θ, -τ)
    holds exactly. Cells outside the inscribed disc are cut off at the last bin.

    CPU images without gradient go through a compiled loop; CUDA and autograd through torch's
    ``index_add``. Both agree to 1e-5.

    Args:
        image: (..., n, n), bool, integer or float: a tensor, or anything like an array.
        angles: rows of θ over the range; even for a full turn, whose second half mirrors the first.
        bins: bins of τ over [-extent, extent]; n by default.
        extent: half the side of the image.
        theta_range: 'full', θ over [0, 2π), or 'half', θ over [0, π), in equal steps without the
            end point. With 'half', a turn of the image by +π k / angles shifts the rows by +k,
            and rows that pass the end come back flipped in τ.

    Raises:
        DataError: images that are not square, or nothing like an array of real numbers.
        ConfigError: an unknown theta_range, or an impossible number of angles or bins.

    >>> image = torch.zeros(4, 4)
    >>> image[3, 0] = 1.0  # x forward, y to the right
    >>> radon(image, angles=4)
    tensor([[0.0000, 0.0000, 0.0000, 0.5000],
            [0.5000, 0.0000, 0.0000, 0.0000],
            [0.5000, 0.0000, 0.0000, 0.0000],
            [0.0000, 0.0000, 0.0000, 0.5000]])
    """
    image = real_tensor("radon: image", image)
    if image.ndim < 2 or image.shape[-1] != image.shape[-2] or not image.shape[-1]:
        raise DataError(f"radon: image of shape {tuple(image.shape)}, expected (..., n, n)")
    checks.one_of("radon.theta_range", theta_range, ThetaRange)
    if checks.count("radon.angles", angles) % 2 and theta_range == "full":
        raise ConfigError(f"radon.angles: {angles}, expected an even number over a full turn")
    count = angles // 2 if theta_range == "full" else angles
    size = image.shape[-1]
    bins = size if bins is None else checks.count("radon.bins", bins)
    checks.positive("radon.extent", extent, "metres")
    batch = image.reshape(-1, size, size)
    compiled = batch.device.type == "cpu" and not (batch.requires_grad and torch.is_grad_enabled())
    if compiled:
        rows = _compiled(batch, count, angles, bins, 2 * extent / size)
    else:
        rows = _half_turn(batch.to(torch.float32), count, bins)
        rows = torch.cat([rows, rows.flip(-1)], dim=-2) if theta_range == "full" else rows
        rows = rows * (2 * extent / size)
    return rows.reshape(*image.shape[:-2], angles, bins)


@lru_cache
@torch.inference_mode(False)
def _directions(count: int) -> tuple[Float32[Tensor, " {count}"], Float32[Tensor, " {count}"]]:
    """Cosines and sines of ``count`` angles over half a turn, in float64 before rounding."""
    theta = torch.arange(count, dtype=torch.float64) * (math.pi / count)
    return torch.cos(theta).float(), torch.sin(theta).float()


def _compiled(
    batch: Shaped[Tensor, "batch n n"], count: int, angles: int, bins: int, unit: float
) -> Float32[Tensor, "batch {angles} {bins}"]:
    from deepring.core import _radon_kernel

    cosines, sines = (direction.numpy() for direction in _directions(count))
    out = torch.empty(len(batch), angles, bins)
    scale = np.float32(bins / batch.shape[-1])
    bits = batch.dtype == torch.bool
    images = batch.view(torch.uint8) if bits else batch.detach().to(torch.float32)
    images = images.contiguous()
    _radon_kernel.radon(images.numpy(), cosines, sines, scale, np.float32(unit), out.numpy())
    return out


def _half_turn(
    batch: Float[Tensor, "batch n n"], count: int, bins: int
) -> Float[Tensor, "batch {count} {bins}"]:
    """The same in plain torch: one ``index_add`` of all occupied cells and angles."""
    size, scale = batch.shape[-1], bins / batch.shape[-1]
    b, i, j = batch.detach().nonzero(as_tuple=True)
    centre = (size - 1) / 2
    cosines, sines = (direction.to(batch.device) for direction in _directions(count))
    x, y = (i - centre) * scale, (j - centre) * scale
    position = cosines[:, None] * x + sines[:, None] * y + (bins - 1) / 2
    lower = position.floor()
    share = position - lower
    values = batch[b, i, j] * scale

    rows = (b * count + torch.arange(count, device=batch.device)[:, None]) * (bins + 2)
    # One spare bin on either side takes contributions beyond the ends.
    index = rows + lower.long().clamp(-1, bins - 1) + 1
    inside = (lower >= -1) & (lower < bins)
    flat = batch.new_zeros(len(batch) * count * (bins + 2))
    flat = flat.index_add(0, index.flatten(), ((1 - share) * values * inside).flatten())
    flat = flat.index_add(0, index.flatten() + 1, (share * values * inside).flatten())
    return flat.view(len(batch), count, bins + 2)[..., 1:-1]

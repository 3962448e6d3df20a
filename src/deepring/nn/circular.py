"""Convolution and upsampling that wrap around in θ (paper, Eq. 5).

Over a full turn θ wraps. Over half a turn it wraps with τ flipped, R(θ + π, τ) = R(θ, -τ): the
sinogram is a Möbius strip.
"""

from functools import lru_cache
from typing import Any, Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from deepring import checks
from deepring.core.radon import ThetaRange
from deepring.errors import ConfigError

TauPadding = Literal["circular", "zero"]


def circular_pad(
    x: Float[Tensor, "batch channel theta tau"],
    pad: int,
    tau: TauPadding = "circular",
    theta_range: ThetaRange = "full",
) -> Float[Tensor, "batch channel theta+2*{pad} tau+2*{pad}"]:
    """Pad (b, c, θ, τ) by ``pad`` on every side: θ always wraps, τ wraps or takes zeros."""
    wraps = tau == "circular" and theta_range == "full" and pad <= min(x.shape[-2:])
    if wraps and not torch.is_grad_enabled() and not torch.compiler.is_compiling():
        return F.pad(x, (pad,) * 4, mode="circular")  # the same values, in half the time
    padded: Tensor = _CircularPad.apply(x, pad, tau, theta_range)  # type: ignore[no-untyped-call]
    return padded


class _CircularPad(torch.autograd.Function):
    """One pass over memory in either direction; torch's own circular padding needs several."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, pad: int, tau: TauPadding, theta_range: ThetaRange) -> Tensor:
        ctx.pad, ctx.tau, ctx.theta_range = pad, tau, theta_range
        rows, columns = x.shape[-2:]
        out = x.new_empty(*x.shape[:-2], rows + 2 * pad, columns + 2 * pad)
        inner = out[..., pad : rows + pad, :]
        inner[..., pad : columns + pad] = x
        inner[..., :pad] = x[..., -pad:] if tau == "circular" else 0
        inner[..., columns + pad :] = x[..., :pad] if tau == "circular" else 0
        out[..., :pad, :] = _beyond(inner[..., -pad:, :], theta_range)
        out[..., rows + pad :, :] = _beyond(inner[..., :pad, :], theta_range)
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        pad = ctx.pad
        rows, columns = gradient.shape[-2] - 2 * pad, gradient.shape[-1] - 2 * pad
        # The gradient of each border is added at its source: rows first, then columns.
        before = _beyond(gradient[..., rows + pad :, :], ctx.theta_range)
        after = _beyond(gradient[..., :pad, :], ctx.theta_range)

        def fold_rows(part: slice) -> Tensor:
            out = gradient[..., pad : rows + pad, part].clone(memory_format=torch.contiguous_format)
            out[..., :pad, :] += before[..., part]
            out[..., -pad:, :] += after[..., part]
            return out

        out = fold_rows(slice(pad, columns + pad))
        if ctx.tau == "circular":
            out[..., :pad] += fold_rows(slice(columns + pad, None))
            out[..., -pad:] += fold_rows(slice(pad))
        return out, None, None, None


def _beyond(
    rows: Float[Tensor, "*batch rows tau"], theta_range: ThetaRange
) -> Float[Tensor, "*batch rows tau"]:
    """Rows as they continue past the end of θ: unchanged, or over half a turn flipped in τ."""
    return rows if theta_range == "full" else rows.flip(-1)


class CircularConv2d(nn.Module):
    """A convolution that commutes with circular shifts of θ, and of τ with circular padding.

    Shape: (b, in, θ, τ) -> (b, out, θ, τ). The kernel is odd, the stride one. Over half a turn
    it is made symmetric in τ, since a row that passes the end comes back flipped.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 3,
        tau: TauPadding = "circular",
        theta_range: ThetaRange = "full",
        *,
        bias: bool = True,
    ) -> None:
        super().__init__()
        if checks.count("encoder.kernel", kernel) % 2 == 0:
            raise ConfigError(f"encoder.kernel: {kernel}, expected an odd number")
        checks.one_of("encoder.tau_padding", tau, TauPadding)
        checks.one_of("representation.theta_range", theta_range, ThetaRange)
        self.tau, self.theta_range = tau, theta_range
        self.pad = kernel // 2
        self.conv = nn.Conv2d(in_channels, out_channels, kernel, bias=bias)

    def forward(
        self, x: Float[Tensor, "batch channel theta tau"]
    ) -> Float[Tensor, "batch {self.conv.out_channels} theta tau"]:
        """Convolve with wrapped borders."""
        if self.pad:
            x = circular_pad(x, self.pad, self.tau, self.theta_range)
        if self.theta_range == "full":
            return self.conv(x)
        weight = (self.conv.weight + self.conv.weight.flip(-1)) / 2
        return F.conv2d(x, weight, self.conv.bias)


def circular_upsample(
    x: Float[Tensor, "batch channel theta tau"],
    tau: TauPadding = "circular",
    theta_range: ThetaRange = "full",
) -> Float[Tensor, "batch channel 2*theta 2*tau"]:
    """Bilinear doubling of θ and τ that wraps: (b, c, θ, τ) -> (b, c, 2θ, 2τ).

    torch's own interpolation clamps at the borders, which breaks shift equivariance. Doubling is
    linear and separable: one matrix product per axis is faster than padding, interpolating and
    cropping.
    """
    rows, columns = x.shape[-2:]
    x = x @ _doubling(columns, tau == "circular").to(x).T
    if theta_range == "full":
        return _doubling(rows, True).to(x) @ x
    padded = torch.cat([x[..., -1:, :].flip(-1), x, x[..., :1, :].flip(-1)], dim=-2)
    return _doubling(rows + 2, True)[2:-2].to(x) @ padded


@lru_cache
@torch.inference_mode(False)  # cached, possibly for training
def _doubling(n: int, wraps: bool) -> Float[Tensor, "2*{n} {n}"]:
    """Matrix (2n, n): samples 2k and 2k + 1 are 3/4 of sample k and 1/4 of its neighbour there.

    At the ends the neighbour is the sample at the other end, or the sample itself.
    """
    samples = torch.arange(2 * n)
    neighbours = samples // 2 + torch.where(samples % 2 == 0, -1, 1)
    neighbours = neighbours % n if wraps else neighbours.clamp(0, n - 1)
    one = torch.eye(n)
    return 0.75 * one[samples // 2] + 0.25 * one[neighbours]

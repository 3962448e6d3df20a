"""Convolution and upsampling that close the circle of θ (paper, Eq. 5).

Over a full turn θ wraps. Over half a turn it wraps with τ flipped, R(θ + π, τ) = R(θ, -τ): the
sinogram is a Möbius strip.
"""

from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from deepring.core.radon import Turn, expect_turn
from deepring.errors import DeepringError

TauPadding = Literal["circular", "zero"]


def pad_theta(x: Tensor, pad: int, turn: Turn = "full") -> Tensor:
    """Pad the rows of (b, c, θ, τ) by ``pad`` before the first and after the last."""
    if turn == "full":
        return F.pad(x, (0, 0, pad, pad), mode="circular")
    return torch.cat([x[..., -pad:, :].flip(-1), x, x[..., :pad, :].flip(-1)], dim=-2)


def circular_pad(x: Tensor, pad: int, tau: TauPadding = "circular", turn: Turn = "full") -> Tensor:
    """Pad (b, c, θ, τ) by ``pad`` on every side: θ always wraps, τ wraps or takes zeros."""
    x = pad_theta(x, pad, turn)
    return F.pad(x, (pad, pad, 0, 0), mode="circular" if tau == "circular" else "constant")


class CircularConv2d(nn.Module):
    """A convolution that commutes with circular shifts of θ (and of τ, where τ wraps).

    Shape: (b, in, θ, τ) -> (b, out, θ, τ). The kernel is odd, the stride one. Over half a turn
    it is made symmetric in τ, since a row that passes the end comes back flipped.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 3,
        tau: TauPadding = "circular",
        turn: Turn = "full",
        *,
        bias: bool = True,
    ) -> None:
        super().__init__()
        if kernel < 1 or kernel % 2 == 0:
            raise DeepringError(f"encoder.kernel: {kernel}, expected an odd number, at least 1")
        if tau not in ("circular", "zero"):
            raise DeepringError(f"encoder.tau_padding: {tau!r}, expected 'circular' or 'zero'")
        expect_turn("representation.turn", turn)
        self.tau, self.turn = tau, turn
        self.pad = kernel // 2
        self.conv = nn.Conv2d(in_channels, out_channels, kernel, bias=bias)

    def forward(self, x: Tensor) -> Tensor:
        """Convolve with wrapped borders."""
        if self.pad:
            x = circular_pad(x, self.pad, self.tau, self.turn)
        if self.turn == "full":
            return self.conv(x)
        weight = (self.conv.weight + self.conv.weight.flip(-1)) / 2
        return F.conv2d(x, weight, self.conv.bias)


def circular_upsample(x: Tensor, tau: TauPadding = "circular", turn: Turn = "full") -> Tensor:
    """Bilinear doubling of θ and τ that wraps: (b, c, θ, τ) -> (b, c, 2θ, 2τ).

    torch's own interpolation clamps at the borders, which breaks the shift equivariance there.
    """
    padded = pad_theta(x, 1, turn)
    padded = F.pad(padded, (1, 1, 0, 0), mode="circular" if tau == "circular" else "replicate")
    doubled = F.interpolate(padded, scale_factor=2, mode="bilinear", align_corners=False)
    return doubled[..., 2:-2, 2:-2]

"""Convolution and upsampling that close the circle of θ (paper, Eq. 5)."""

from typing import Literal

import torch.nn.functional as F
from torch import Tensor, nn

from deepring.errors import DeepringError

TauPadding = Literal["circular", "zero"]


def circular_pad(x: Tensor, pad: int, tau: TauPadding = "circular") -> Tensor:
    """Pad (b, c, θ, τ) by ``pad`` on every side: θ always wraps, τ wraps or takes zeros."""
    x = F.pad(x, (0, 0, pad, pad), mode="circular")
    return F.pad(x, (pad, pad, 0, 0), mode="circular" if tau == "circular" else "constant")


class CircularConv2d(nn.Module):
    """A convolution that commutes with circular shifts of θ (and of τ, where τ wraps).

    Shape: (b, in, θ, τ) -> (b, out, θ, τ). The kernel is odd, the stride one.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int = 3,
        tau: TauPadding = "circular",
        *,
        bias: bool = True,
    ) -> None:
        super().__init__()
        if kernel < 1 or kernel % 2 == 0:
            raise DeepringError(f"encoder.kernel: {kernel}, expected an odd number, at least 1")
        if tau not in ("circular", "zero"):
            raise DeepringError(f"encoder.tau_padding: {tau!r}, expected 'circular' or 'zero'")
        self.tau = tau
        self.pad = kernel // 2
        self.conv = nn.Conv2d(in_channels, out_channels, kernel, bias=bias)

    def forward(self, x: Tensor) -> Tensor:
        """Convolve with wrapped borders."""
        return self.conv(circular_pad(x, self.pad, self.tau)) if self.pad else self.conv(x)


def circular_upsample(x: Tensor, tau: TauPadding = "circular") -> Tensor:
    """Bilinear doubling of θ and τ that wraps: (b, c, θ, τ) -> (b, c, 2θ, 2τ).

    torch's own interpolation clamps at the borders, which breaks the shift equivariance there.
    """
    padded = F.pad(x, (0, 0, 1, 1), mode="circular")
    padded = F.pad(padded, (1, 1, 0, 0), mode="circular" if tau == "circular" else "replicate")
    doubled = F.interpolate(padded, scale_factor=2, mode="bilinear", align_corners=False)
    return doubled[..., 2:-2, 2:-2]

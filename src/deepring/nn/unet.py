"""The feature extraction network: a UNet of circular convolutions (paper, Sec. III-B, Eq. 6)."""

import math
from collections.abc import Callable, Sequence
from functools import partial

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks
from deepring.core.radon import ThetaRange
from deepring.errors import ConfigError, DataError
from deepring.nn.circular import CircularConv2d, TauPadding, circular_upsample

NORMALISATIONS: dict[str, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    "group": lambda channels: nn.GroupNorm(math.gcd(8, channels), channels),
    "none": lambda _: nn.Identity(),
}
"""Layers after a convolution, by name, made for a number of channels."""


#: Values of one level, for one scan.
_MOST_VALUES = 2**25


class ConvBlock(nn.Sequential):
    """``convolutions`` times circular 3x3 convolution, normalisation, ReLU."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        convolutions: int,
        norm: str,
        tau: TauPadding,
        theta_range: ThetaRange,
    ) -> None:
        layers: list[nn.Module] = []
        for k in range(convolutions):
            source = in_channels if k == 0 else out_channels
            layers += [
                CircularConv2d(source, out_channels, 3, tau, theta_range, bias=norm == "none"),
                NORMALISATIONS[norm](out_channels),
                nn.ReLU(inplace=True),
            ]
        super().__init__(*layers)


class UNet(nn.Module):
    """Blocks down and up with skip connections: (b, in, rows, columns) -> (b, out, rows, columns).

    Args:
        name: config key of the widths, for messages.
        widths: channels of each level; the number of levels is its length.
        in_channels: channels of the input.
        out_channels: channels of the output.
        block: makes one level from its numbers of input and output channels.
        upsample: doubles the rows and columns of (b, c, rows, columns).
    """

    def __init__(
        self,
        name: str,
        widths: Sequence[int],
        in_channels: int,
        out_channels: int,
        block: Callable[[int, int], nn.Module],
        upsample: Callable[[Tensor], Tensor],
    ) -> None:
        super().__init__()
        self.name, self.upsample = name, upsample
        self.stride = 2 ** (len(widths) - 1)
        sources = [in_channels, *widths[:-1]]
        self.down = nn.ModuleList(block(a, b) for a, b in zip(sources, widths, strict=True))
        self.up = nn.ModuleList(
            block(deep + skip, skip)
            for deep, skip in zip(widths[:0:-1], widths[-2::-1], strict=True)
        )
        self.pool = nn.MaxPool2d(2)
        self.head = nn.Conv2d(widths[0], out_channels, 1)

    def forward(
        self, x: Float[Tensor, "batch channel rows columns"]
    ) -> Float[Tensor, "batch {self.head.out_channels} rows columns"]:
        """Feature map (b, out, rows, columns) of (b, in, rows, columns)."""
        if x.shape[-2] % self.stride or x.shape[-1] % self.stride:
            raise DataError(
                f"{self.name}: {len(self.down)} levels halve rows and columns to a total stride of "
                f"{self.stride}, which does not divide {x.shape[-2]} x {x.shape[-1]}; choose fewer "
                "levels or other numbers of rows"
            )
        skips = []
        for block in self.down[:-1]:
            x = block(x)
            skips.append(x)
            x = self._halved(x)
        x = self.down[-1](x)
        for block, skip in zip(self.up, reversed(skips), strict=True):
            x = block(torch.cat([self.upsample(x), skip], dim=1))
        return self.head(x)

    def _halved(
        self, x: Float[Tensor, "batch channel rows columns"]
    ) -> Float[Tensor, "batch channel rows//2 columns//2"]:
        """The largest of 2 x 2 values each."""
        plain = torch.compiler.is_compiling() or x.device.type != "cpu"  # exported or compiled
        if plain or torch.is_grad_enabled():
            pooled: Tensor = self.pool(x)
            return pooled
        # The same values; torch's pooling also finds where they are, for a gradient.
        rows = torch.maximum(x[..., ::2, :], x[..., 1::2, :])
        return torch.maximum(rows[..., ::2], rows[..., 1::2])


class CircularUNet(UNet):
    """UNet over (b, in, θ, τ) -> (b, out, θ / stem, τ / stem), equivariant to shifts of θ by its
    stride times ``stem``.

    Each level except the last halves θ and τ by max pooling; the way up doubles them by wrapped
    bilinear interpolation and concatenates the skip. A final 1x1 convolution gives the feature map.

    Args:
        widths: channels of each level; the number of levels is its length.
        in_channels: channels of the representation.
        out_channels: channels of the feature map.
        convolutions: 3x3 convolutions per block.
        norm: 'batch', 'group' or 'none'.
        tau_padding: padding of τ, 'circular' (the paper's Eq. 5) or 'zero'.
        theta_range: 'full' or 'half'; over half a turn kernels are symmetric in τ, and an even
            number of τ bins at each level keeps the flip exact.
        stem: space-to-depth factor at the start; 1 disables it. Requires 'full'.
        name: config key of these settings, for messages.
    """

    def __init__(
        self,
        widths: Sequence[int] = (64, 128, 256, 512),
        in_channels: int = 1,
        out_channels: int = 1,
        convolutions: int = 2,
        norm: str = "batch",
        tau_padding: TauPadding = "circular",
        theta_range: ThetaRange = "full",
        stem: int = 1,
        name: str = "encoder",
    ) -> None:
        checks.widths(f"{name}.widths", widths)
        checks.count(f"{name}.convolutions", convolutions, most=64)
        checks.one_of(f"{name}.norm", norm, NORMALISATIONS)
        if checks.count(f"{name}.stem", stem, most=64) > 1 and theta_range == "half":
            raise ConfigError(
                f"{name}.stem: {stem}, expected 1 for theta_range 'half', whose flip of "
                "τ would have to exchange channels"
            )
        super().__init__(
            f"{name}.widths",
            widths,
            in_channels * stem**2,
            out_channels,
            lambda a, b: ConvBlock(a, b, convolutions, norm, tau_padding, theta_range),
            partial(circular_upsample, tau=tau_padding, theta_range=theta_range),
        )
        self.widths, self.stem = tuple(widths), stem

    def check_size(self, rows: int, columns: int) -> None:
        """Raise ConfigError unless it can halve ``rows`` x ``columns``, which are bearably many."""
        step = self.stem * self.stride
        if rows % step or columns % step:
            stem = f" and a stem of {self.stem}" if self.stem > 1 else ""
            raise ConfigError(
                f"{self.name}: {len(self.widths)} levels{stem} divide rows and columns by {step}, "
                f"expected a divisor of {rows} x {columns}; choose fewer levels or other numbers "
                "of rows"
            )
        widest = max(width / 4**level for level, width in enumerate(self.widths))
        if rows * columns * widest / self.stem**2 > _MOST_VALUES:
            raise ConfigError(
                f"{self.name}: {list(self.widths)} over {rows} x {columns}, expected at most "
                f"{_MOST_VALUES} values in a level; choose fewer channels, a stem or a pool"
            )

    def forward(
        self, x: Float[Tensor, "batch channel theta tau"]
    ) -> Float[Tensor, "batch out theta//{self.stem} tau//{self.stem}"]:
        """Feature map (b, out, θ / stem, τ / stem) of (b, in, θ, τ)."""
        if x.shape[-2] % self.stem or x.shape[-1] % self.stem:
            raise DataError(
                f"encoder.stem: {self.stem}, expected a divisor of {x.shape[-2]} x {x.shape[-1]}, "
                "the rows and columns"
            )
        return super().forward(F.pixel_unshuffle(x, self.stem) if self.stem > 1 else x)

"""The feature extraction network: a UNet of circular convolutions (paper, Sec. III-B)."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from deepring.core.radon import Turn
from deepring.errors import DeepringError
from deepring.nn.circular import CircularConv2d, TauPadding, circular_upsample


def _normalisation(kind: str, channels: int) -> nn.Module:
    match kind:
        case "batch":
            return nn.BatchNorm2d(channels)
        case "group":
            return nn.GroupNorm(math.gcd(8, channels), channels)
        case "none":
            return nn.Identity()
    raise DeepringError(f"encoder.norm: {kind!r}, expected 'batch', 'group' or 'none'")


class Block(nn.Sequential):
    """``convolutions`` times circular 3x3 convolution, normalisation, ReLU."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        convolutions: int,
        norm: str,
        tau: TauPadding,
        turn: Turn,
    ) -> None:
        layers: list[nn.Module] = []
        for k in range(convolutions):
            source = in_channels if k == 0 else out_channels
            layers += [
                CircularConv2d(source, out_channels, 3, tau, turn, bias=norm == "none"),
                _normalisation(norm, out_channels),
                nn.ReLU(inplace=True),
            ]
        super().__init__(*layers)


class UNet(nn.Module):
    """Blocks down and up, joined by skips: (b, in, rows, columns) -> (b, out, rows, columns).

    Args:
        name: of the config key that the widths come from, for messages.
        widths: channels of each level; the number of levels is its length.
        in_channels: channels of the input.
        out_channels: channels of the output.
        block: makes a level of in and out channels.
    """

    def __init__(
        self,
        name: str,
        widths: Sequence[int],
        in_channels: int,
        out_channels: int,
        block: Callable[[int, int], nn.Module],
    ) -> None:
        super().__init__()
        self.name = name
        self.stride = 2 ** (len(widths) - 1)
        sources = [in_channels, *widths[:-1]]
        self.down = nn.ModuleList(block(a, b) for a, b in zip(sources, widths, strict=True))
        self.up = nn.ModuleList(
            block(deep + skip, skip)
            for deep, skip in zip(widths[:0:-1], widths[-2::-1], strict=True)
        )
        self.pool = nn.MaxPool2d(2)
        self.head = nn.Conv2d(widths[0], out_channels, 1)

    def upsample(self, x: Tensor) -> Tensor:
        """Twice the rows and columns."""
        raise NotImplementedError

    def forward(self, x: Tensor) -> Tensor:
        """Feature map (b, out, rows, columns) of (b, in, rows, columns)."""
        if x.shape[-2] % self.stride or x.shape[-1] % self.stride:
            raise DeepringError(
                f"{self.name}: {len(self.down)} levels halve rows and columns to a total stride of "
                f"{self.stride}, which does not divide {x.shape[-2]} x {x.shape[-1]}; take fewer "
                "levels or other numbers of rows"
            )
        skips = []
        for block in self.down[:-1]:
            x = block(x)
            skips.append(x)
            x = self.pool(x)
        x = self.down[-1](x)
        for block, skip in zip(self.up, reversed(skips), strict=True):
            x = block(torch.cat([self.upsample(x), skip], dim=1))
        return self.head(x)


class CircularUNet(UNet):
    """UNet over (b, in, θ, τ) -> (b, out, θ, τ), equivariant to shifts of θ by its stride.

    Each level but the last halves θ and τ by max pooling; the way up doubles them by wrapped
    bilinear interpolation and joins the skip. A last 1x1 convolution gives the feature map.

    Args:
        widths: channels of each level; the number of levels is its length.
        in_channels: channels of the representation.
        out_channels: channels of the feature map.
        convolutions: 3x3 convolutions a block.
        norm: 'batch', 'group' or 'none'.
        tau_padding: how τ is padded, 'circular' (the paper's Eq. 5) or 'zero'.
        turn: range of θ, 'full' or 'half'; over half a turn kernels are symmetric in τ and an
            even number of τ bins at each level keeps the flip exact.
    """

    def __init__(
        self,
        widths: Sequence[int] = (64, 128, 256, 512),
        in_channels: int = 1,
        out_channels: int = 1,
        convolutions: int = 2,
        norm: str = "batch",
        tau_padding: TauPadding = "circular",
        turn: Turn = "full",
    ) -> None:
        if not widths or min(widths) < 1 or convolutions < 1:
            raise DeepringError(
                f"encoder: widths={list(widths)}, convolutions={convolutions}; "
                "expected at least one level, channel and convolution"
            )
        super().__init__(
            "encoder.widths",
            widths,
            in_channels,
            out_channels,
            lambda a, b: Block(a, b, convolutions, norm, tau_padding, turn),
        )
        self.tau, self.turn = tau_padding, turn

    def upsample(self, x: Tensor) -> Tensor:
        """Twice the rows and columns, by wrapped bilinear interpolation."""
        return circular_upsample(x, self.tau, self.turn)

"""DiSCO's feature extraction network over polar occupancy (Xu et al., RA-L 2021)."""

from collections.abc import Sequence
from functools import partial
from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.nn.circular import CircularConv2d, circular_upsample
from deepring.nn.unet import UNet

PolarPadding = Literal["zero", "circular"]


class DiscoUNet(UNet):
    """UNet over (b, heights, θ, r) -> (b, θ, r), as published in MaverickPeter/DiSCO-pytorch.

    Each level has two 3x3 convolutions with batch norm and ReLU; the way down halves θ and r by
    max pooling, the way up doubles them bilinearly and joins the skip. The last activation before
    the 1x1 head is a sigmoid; the head itself has none, in the published code, so that values are
    not confined to [0, 1]. (The convolutions' biases, which batch norm undoes, are left out.)

    Args:
        in_channels: layers of height.
        widths: channels of each level; the number of levels is its length.
        padding: 'zero', the published code's: zeros around θ and r and interpolation with aligned
            corners, so that a turn of the scan is not quite a shift of the feature; 'circular'
            closes θ as `CircularUNet` does, zeros around r alone: shifts of θ by the stride pass
            through exactly.

    Raises:
        ConfigError: no level or no channel, another padding, an image the stride cannot halve.
    """

    def __init__(
        self,
        in_channels: int = 20,
        widths: Sequence[int] = (64, 128, 256, 512),
        padding: PolarPadding = "zero",
    ) -> None:
        checks.widths("disco.widths", widths)
        if padding not in ("zero", "circular"):
            raise ConfigError(f"disco.padding: {padding!r}, expected 'zero' or 'circular'")
        super().__init__(
            "disco.widths",
            widths,
            in_channels,
            1,
            lambda a, b: _block(a, b, padding),
            partial(circular_upsample, tau="zero") if padding == "circular" else _published,
        )
        last = (self.up or self.down)[-1]
        assert isinstance(last, nn.Sequential)
        last[-1] = nn.Sigmoid()

    def forward(self, x: Float[Tensor, "batch height theta r"]) -> Float[Tensor, "batch theta r"]:
        """Feature maps (b, θ, r) of polar occupancy (b, heights, θ, r)."""
        return super().forward(x)[:, 0]


def _published(
    x: Float[Tensor, "batch channel theta r"],
) -> Float[Tensor, "batch channel 2*theta 2*r"]:
    """Twice θ and r, as the published code does."""
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=True)


def _block(in_channels: int, out_channels: int, padding: PolarPadding) -> nn.Sequential:
    layers: list[nn.Module] = []
    for source in (in_channels, out_channels):
        if padding == "circular":
            layers.append(CircularConv2d(source, out_channels, 3, "zero", bias=False))
        else:
            layers.append(nn.Conv2d(source, out_channels, 3, padding=1, bias=False))
        layers += [nn.BatchNorm2d(out_channels), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)

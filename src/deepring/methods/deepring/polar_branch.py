"""A second look at the same BEV, over azimuth and range, beside the sinogram's.

The sinogram's rows and their magnitudes see where a place is whatever the offset, and hardly know
how far along the street. A polar image knows that, and bears little offset. A turn of the scan
shifts the rows of both, so that their correlation curves add before the maximum: one descriptor
(θ, ω + r), one search, one yaw. Not in the paper.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from deepring.checks import between, count, fraction
from deepring.errors import ConfigError
from deepring.methods.network import PlainSettings
from deepring.nn.polar_bev import PolarBev
from deepring.nn.unet import CircularUNet
from deepring.rasters import BevRaster, Raster

#: Samples of one polar image.
_MOST_SAMPLES = 2**24


@dataclass(frozen=True)
class PolarSettings(PlainSettings):
    """A second network over a polar image of the BEV, whose rows are those of the descriptor."""

    widths: Sequence[int] = (8, 16, 32)  # a UNet of its own; see `deepring.nn.unet`
    convolutions: int = 1  # of each level
    norm: str = "batch"  # or group, none
    rings: int = 60  # cells along r
    radius: float | None = None  # metres; None for the BEV's extent
    samples: int = 2  # see `deepring.nn.polar_bev`
    share: float = 0.2  # of the score, to begin with: it is learned


class PolarBranch(nn.Module):
    """BEV (b, n, n) -> feature (b, θ, r), to be normalised and joined to the sinogram's.

    The UNet wraps around in θ and meets zeros beyond the ends of r.

    Args:
        settings: of the branch.
        raster: of the network; a BEV.
        rows: of the descriptor, θ.

    Raises ConfigError that names the key of a value that does not fit.
    """

    def __init__(self, settings: PolarSettings, raster: Raster, rows: int) -> None:
        super().__init__()
        if not isinstance(raster, BevRaster):
            raise ConfigError(
                f"polar: a second look at a {type(raster).__name__}, expected a BEV, which is "
                "resampled; take the representation sinogram, or polar: null"
            )
        rings = count("polar.rings", settings.rings, most=4096)
        samples = count("polar.samples", settings.samples, most=64)
        if rows * rings * samples**2 > _MOST_SAMPLES:
            raise ConfigError(
                f"polar.samples: {samples} along each side of {rows} x {rings} sectors and rings, "
                f"expected at most {_MOST_SAMPLES} samples; choose fewer"
            )
        radius = raster.extent if settings.radius is None else settings.radius
        between("polar.radius", radius, raster.extent / 1000, raster.extent, "metres")
        self.image = PolarBev(rows, rings, radius / raster.extent, samples)
        self.encoder = CircularUNet(
            settings.widths,
            convolutions=settings.convolutions,
            norm=settings.norm,
            tau_padding="zero",
            name="polar",
        )
        self.encoder.check_size(rows, rings)
        share = fraction("polar.share", settings.share)
        self.logit = nn.Parameter(torch.tensor(math.log(share) - math.log1p(-share)))

    @property
    def share(self) -> Float[Tensor, ""]:
        """What the branch has of the score, in (0, 1)."""
        return self.logit.sigmoid()

    def forward(
        self, rasters: Shaped[Tensor, "batch x y"]
    ) -> Float[Tensor, "batch theta {self.image.rings}"]:
        """Features of the batch."""
        feature: Tensor = self.encoder(self.image(rasters))[:, 0]
        return feature.float()

    def joined(
        self, sinogram: Float[Tensor, "batch theta omega"], polar: Float[Tensor, "batch theta r"]
    ) -> Float[Tensor, "batch theta omega+r"]:
        """One descriptor of both parts, each weighted by the root of its share.

        At every turn its correlation with another is (1 - share) times that of the sinogram's
        parts, and share times that of the polar ones. Where both parts have unit norm, so has it.
        """
        share = self.share
        return torch.cat([sinogram * (1 - share).sqrt(), polar * share.sqrt()], dim=-1)

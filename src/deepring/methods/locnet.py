"""LocNet (Yin et al., IV 2018 and T-ITS 2019): convolutions over histograms of rings."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor, nn

from deepring import checks
from deepring.errors import ConfigError
from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.rasters import RingHistogramRaster, raster_settings

#: Rows and columns of a convolution's kernel.
_KERNEL = 5


@dataclass(frozen=True)
class LocNetSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "LocNet"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(RingHistogramRaster()))
    channels: Sequence[int] = (50, 100)  # of the two convolutions
    dimension: int = 50  # length of a descriptor


class LocNet(VectorNetwork):
    """Histograms (b, rows, buckets) -> two convolutions with pooling -> (b, dimension), no less
    than 0.

    Descriptors have no unit norm: the margin of `Contrastive` is their scale. No turn of a scan
    changes its histograms, and so none changes its descriptor.
    """

    settings_class = LocNetSettings
    settings: LocNetSettings

    def __init__(self, settings: LocNetSettings | None = None) -> None:
        settings = LocNetSettings() if settings is None else settings
        super().__init__(settings, RingHistogramRaster)
        if len(settings.channels) != 2:
            raise ConfigError(
                f"locnet.channels: {list(settings.channels)}, expected two numbers, one for each "
                "convolution"
            )
        first, second = (checks.count("locnet.channels", n, most=8192) for n in settings.channels)
        dimension = checks.count("locnet.dimension", settings.dimension, most=8192)
        rows, buckets = (_pooled(_pooled(length)) for length in self.raster.shape)
        if rows < 1 or buckets < 1:
            raise ConfigError(
                f"locnet: a raster of {' x '.join(map(str, self.raster.shape))}, expected at least "
                "16 rows and 16 buckets, since two convolutions and two poolings shorten both"
            )
        self.layers = nn.Sequential(
            nn.Conv2d(1, first, _KERNEL),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Conv2d(first, second, _KERNEL),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Flatten(),
            nn.Linear(second * rows * buckets, dimension),
            nn.ReLU(),
        )
        for layer in self.layers:
            if isinstance(layer, nn.Conv2d | nn.Linear) and layer.bias is not None:
                nn.init.xavier_uniform_(layer.weight)
                nn.init.zeros_(layer.bias)

    def forward(self, rasters: Float[Tensor, "batch row bucket"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, dimension) float32 of histograms (b, rows, buckets)."""
        features: Tensor = self.layers(rasters.float()[:, None])
        return features

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.dimension,)


def _pooled(length: int) -> int:
    """Length after a convolution without padding and a pooling of two."""
    return (length - _KERNEL + 1) // 2

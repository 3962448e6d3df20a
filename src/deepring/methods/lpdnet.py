"""LPD-Net (Liu et al., ICCV 2019; Suoivy/LPD-net), the variant FN-SF-VLAD."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.nn.edges import NeighbourConv, nearest_rows
from deepring.nn.netvlad import NetVlad
from deepring.nn.pointnet import SharedMlp, TransformNet, aligned
from deepring.rasters import PointFeaturesRaster, raster_settings


@dataclass(frozen=True)
class LpdNetSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "LPD-Net"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(PointFeaturesRaster()))
    use_features: bool = True
    """Whether the network sees the ten features, or the coordinates alone."""
    first: Sequence[int] = (64, 64)  # widths of the layers that points share
    graph: Sequence[int] = (64, 64)  # of the convolution over neighbours among the features
    spatial: Sequence[int] = (64, 64)  # of the convolution over neighbours in the scan
    second: Sequence[int] = (64, 128, 1024)  # widths of the shared layers after these
    neighbours: int = 20  # points nearest to each
    align_features: bool = True
    """Whether features are transformed before neighbours are looked for among them."""
    #: widths of the T-Nets' layers that points share
    transform_widths: Sequence[int] = (64, 128, 1024)
    transform_hidden: Sequence[int] = (512, 256)  # of their dense layers
    clusters: int = 64  # of NetVLAD
    dimension: int = 256  # length of a descriptor
    gating: bool = True  # weighs a descriptor's values by one another


class LpdNet(VectorNetwork):
    """Points with features (b, n, 13) -> features of each (b, n, f) -> NetVLAD -> unit vectors.

    The points are aligned by a T-Net and go with their features through a shared network. Two
    convolutions over neighbours follow: over the nearest in the space of the network's features,
    and over the nearest in the scan. The order of the points changes nothing, but for which of
    equally far neighbours is taken; a turn of the scan does.

    The T-Net of the features chooses neighbours and does nothing else. No gradient reaches it, here
    as in the published code, so that it stays the identity that it begins as; it is kept since a
    network of the published size has it.
    """

    settings_class = LpdNetSettings
    settings: LpdNetSettings

    def __init__(self, settings: LpdNetSettings | None = None) -> None:
        settings = LpdNetSettings() if settings is None else settings
        super().__init__(settings, PointFeaturesRaster)
        _check(settings, self.raster.shape[0])
        transform = (settings.transform_widths, settings.transform_hidden)
        channels = self.raster.shape[1] if settings.use_features else 3
        self.align_points = TransformNet(3, *transform)
        self.first = SharedMlp(channels, settings.first, norm=False)
        self.align_features: TransformNet | None = None
        if settings.align_features:
            self.align_features = TransformNet(settings.first[-1], *transform)
            self.align_features.requires_grad_(requires_grad=False)
        self.graph = NeighbourConv(settings.first[-1], settings.graph, edges=True)
        self.spatial = NeighbourConv(settings.graph[-1], settings.spatial, edges=False)
        self.second = SharedMlp(settings.spatial[-1], settings.second, norm=False)
        self.aggregate = NetVlad(
            settings.second[-1], settings.clusters, settings.dimension, gating=settings.gating
        )

    def forward(self, rasters: Float[Tensor, "batch n 13"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, dimension) float32 of points with features (b, n, 13)."""
        features = F.normalize(self.point_features(rasters.float()), dim=-1)
        return F.normalize(self.aggregate(features), dim=-1)

    def point_features(self, rasters: Float[Tensor, "batch n 13"]) -> Float[Tensor, "batch n f"]:
        """Features of each point (b, n, f), not normalised."""
        points = rasters[..., :3].transpose(1, 2)
        x = aligned(self.align_points(points), points)
        if self.settings.use_features:
            x = torch.cat([x, rasters[..., 3:].transpose(1, 2)], dim=1)
        x = self.first(x)
        near = nearest_rows(self.feature_space(x), self.settings.neighbours)
        x = self.graph(x.transpose(1, 2), near)
        near = nearest_rows(rasters[..., :3], self.settings.neighbours)
        x = self.spatial(x, near)
        return self.second(x.transpose(1, 2)).transpose(1, 2)

    @torch.no_grad()
    def feature_space(self, x: Float[Tensor, "batch channel n"]) -> Float[Tensor, "batch n c"]:
        """The features (b, n, c) among which neighbours are looked for."""
        if self.align_features is not None:
            x = aligned(self.align_features(x), x)
        return x.transpose(1, 2)

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.dimension,)


def _check(settings: LpdNetSettings, points: int) -> None:
    """Raise ConfigError for widths that are none and more neighbours than points."""
    names = ("first", "graph", "spatial", "second", "transform_widths", "transform_hidden")
    for name in names:
        checks.widths(f"lpdnet.{name}", getattr(settings, name))
    checks.count("lpdnet.neighbours", settings.neighbours)
    if settings.neighbours > points:
        raise ConfigError(
            f"lpdnet.neighbours: {settings.neighbours}, expected at most the raster's count of "
            f"{points} points"
        )

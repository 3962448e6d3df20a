"""PointNetVLAD (Uy and Lee, CVPR 2018; mikacuy/pointnetvlad)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.nn.netvlad import NetVlad
from deepring.nn.pointnet import PointFeatures
from deepring.rasters import PointsRaster, raster_settings


@dataclass(frozen=True)
class PointNetVladSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "PointNetVLAD"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(PointsRaster()))
    #: widths of the layers that points share, before the second T-Net
    first: Sequence[int] = (64, 64)
    second: Sequence[int] = (64, 128, 1024)  # of those after it
    #: widths of the T-Nets' layers that points share
    transform_widths: Sequence[int] = (64, 128, 1024)
    transform_hidden: Sequence[int] = (512, 256)  # of their dense layers
    clusters: int = 64  # of NetVLAD
    dimension: int = 256  # length of a descriptor
    gating: bool = True  # weighs a descriptor's values by one another


class PointNetVlad(VectorNetwork):
    """Points (b, n, 3) -> features of each (b, n, f) -> NetVLAD -> descriptors at unit norm.

    The features are taken at unit norm, as in the published TensorFlow code. The order of the
    points changes nothing; a turn of the scan does, since nothing here is invariant to it but
    what training teaches the T-Nets.
    """

    settings_class = PointNetVladSettings
    settings: PointNetVladSettings

    def __init__(self, settings: PointNetVladSettings | None = None) -> None:
        settings = PointNetVladSettings() if settings is None else settings
        super().__init__(settings, PointsRaster)
        self.features = PointFeatures(
            settings.first, settings.second, settings.transform_widths, settings.transform_hidden
        )
        self.aggregate = NetVlad(
            settings.second[-1], settings.clusters, settings.dimension, gating=settings.gating
        )

    def forward(self, rasters: Float[Tensor, "batch n 3"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, dimension) float32 of points (b, n, 3), of any floating type."""
        features = F.normalize(self.features(rasters.float()), dim=-1)
        return F.normalize(self.aggregate(features), dim=-1)

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.dimension,)

"""LCDNet (Cattaneo et al., T-RO 2022): a place's descriptor and the whole relative pose."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float64, Int, Shaped
from torch import Tensor, nn

from deepring import checks
from deepring.methods.given import given_rasters
from deepring.methods.lcdnet.backbone import Backbone, voxels
from deepring.methods.lcdnet.keypoints import BallFeatures, from_above
from deepring.methods.lcdnet.pose_head import Matches, PoseHead
from deepring.methods.network import PlainSettings
from deepring.methods.vector_network import VectorNetwork
from deepring.nn.netvlad import NetVlad
from deepring.rasters import VoxelMeansRaster, raster_settings

#: Radii in voxels of the balls around keypoints, and the points that are looked at in each: among
#: the means of voxels, and at each of the four levels.
_BALLS = (
    ((4, 8), (16, 16)),
    ((4, 8), (16, 16)),
    ((8, 12), (16, 32)),
    ((12, 24), (16, 32)),
    ((24, 48), (16, 32)),
)

#: Places whose keypoints are in memory at once.
_PLACES = 4


@dataclass(frozen=True)
class LcdNetSettings(PlainSettings):
    """Everything that makes a descriptor but the weights. Plain values, kept in checkpoints."""

    label: ClassVar[str] = "LCDNet"

    raster: dict[str, Any] = field(default_factory=lambda: raster_settings(VoxelMeansRaster()))
    widths: Sequence[int] = (16, 32, 64, 64, 128)  # channels of the levels of the voxel network
    features: int = 640  # of a keypoint
    clusters: int = 64  # of NetVLAD
    dimension: int = 256  # length of a descriptor
    epsilon: float = 1.03  # blur of the matching at the beginning, above 0.03; it is learned
    iterations: int = 5  # of the matching, by Sinkhorn
    momentum: float = 0.01  # of the batch statistics, in [0, 1]


class Encoded(NamedTuple):
    """What the network makes of b scans."""

    vectors: Float[Tensor, "batch value"]
    """Descriptors of unit norm."""
    points: Float[Tensor, "batch n 3"]
    """Keypoints, metres."""
    features: Float[Tensor, "batch n channel"]
    """One row for each keypoint."""


class LcdNet(VectorNetwork):
    """Means of voxels (b, max_points, 4) -> descriptors (b, dimension) at unit norm.

    `encode` also returns the keypoints' features, by which `match` and `relative_poses` tell how
    one scan lies in another. A scan without points counts as one point at the sensor's foot.
    """

    settings_class = LcdNetSettings
    settings: LcdNetSettings

    def __init__(self, settings: LcdNetSettings | None = None) -> None:
        settings = LcdNetSettings() if settings is None else settings
        super().__init__(settings, VoxelMeansRaster)
        momentum = checks.between("lcdnet.momentum", settings.momentum, 0, 1)
        raster = self.voxel_raster
        self.backbone = Backbone(4, settings.widths, raster.extent[2], momentum)
        first, *_ = widths = list(settings.widths)[:4]
        channels = ((1, first), *zip(widths, widths, strict=True))
        self.balls = nn.ModuleList(
            BallFeatures(inputs, width, [r * raster.size for r in radii], samples, momentum)
            for (inputs, width), (radii, samples) in zip(channels, _BALLS, strict=True)
        )
        seen = self.backbone.layers * settings.widths[4] + 2 * sum(w for _, w in channels)
        features = checks.count("lcdnet.features", settings.features, most=8192)
        self.fusion = nn.Sequential(
            nn.Linear(seen, features, bias=False), nn.BatchNorm1d(features), nn.ReLU()
        )
        self.aggregation = NetVlad(features, settings.clusters, settings.dimension)
        self.pose_head = PoseHead(settings.epsilon, settings.iterations)

    @property
    def voxel_raster(self) -> VoxelMeansRaster:
        """The raster, which says where voxels lie."""
        assert isinstance(self.raster, VoxelMeansRaster)
        return self.raster

    @property
    def descriptor_shape(self) -> tuple[int]:
        """Length of one descriptor."""
        return (self.settings.dimension,)

    def forward(self, rasters: Int[Tensor, "batch n 4"]) -> Float[Tensor, "batch value"]:
        """Descriptors (b, dimension) float32, at unit norm."""
        if not len(rasters):
            return next(self.parameters()).new_empty(0, self.settings.dimension)
        return self.encode(rasters).vectors

    def encode(self, rasters: Int[Tensor, "batch n 4"]) -> Encoded:
        """Descriptors, and the keypoints with their features, of one scan or more."""
        raster = self.voxel_raster
        points, filled = self._some_points(*raster.in_metres(rasters))
        keypoints = self._keypoints(points[..., :3], filled)
        levels, above = self.backbone(
            voxels(points, filled, raster.corner, raster.size, raster.extent)
        )
        x, y, _ = levels[-1].first
        places = (keypoints[..., :2] - keypoints.new_tensor(raster.corner[:2])) / raster.size
        places = (places - places.new_tensor([x, y])) / above.stride[0]
        seen = [from_above(above, self.backbone.layers, places)]
        of_means, *of_levels = self.balls
        means = points[filled]
        counts = filled.sum(dim=1).tolist()
        seen.append(of_means(keypoints, means[:, :3], means[:, 3:], counts))
        for level, balls in zip(levels, of_levels, strict=True):
            middles, x_of = level.middles(raster.corner, raster.size), level.features
            seen.append(balls(keypoints, middles, x_of.features, x_of.grid.counts))
        stacked = torch.cat(seen, dim=-1)
        features = self.fusion(stacked.flatten(0, 1)).view(*stacked.shape[:2], -1)
        return Encoded(F.normalize(self.aggregation(features), dim=-1), keypoints, features)

    def match(self, first: Encoded, second: Encoded) -> Matches:
        """Where the keypoints of each first scan are in the second; its transform says how."""
        return self.pose_head(first.points, first.features, second.points, second.features)

    @torch.no_grad()
    def relative_poses(
        self, query: Shaped[Tensor, " *raster"], places: Shaped[Tensor, " k *raster"]
    ) -> Float64[Tensor, "k 4 4"]:
        """Rigid transforms (k, 4, 4) that carry each place's points onto the query's.

        NaN where the matches are on a line or at one place. The frames are those of the rasters'
        points: the sensor's axes, z above the ground under it.
        """
        device = next(self.parameters()).device
        rasters = given_rasters(self.raster, torch.as_tensor(query)[None]).to(device)
        found = [torch.empty(0, 4, 4, dtype=torch.float64)]
        training = [module for module in self.modules() if module.training]
        self.eval()
        try:
            seen = self.encode(rasters)
            images = given_rasters(self.raster, places)
            for k in range(0, len(images), _PLACES):
                part = images[k : k + _PLACES]
                there = self.encode(part.to(device))
                here = Encoded(*(x.expand(len(part), *x.shape[1:]) for x in seen))
                matches = self.match(there, here)
                told = matches.told[:, None, None]
                found.append(torch.where(told, matches.transforms, torch.nan).cpu())
        finally:
            for module in training:
                module.training = True
        return torch.cat(found)

    def _some_points(self, points: Tensor, filled: Tensor) -> tuple[Tensor, Tensor]:
        """The same, with one point at the sensor's foot in scans without."""
        empty = ~filled.any(dim=1)
        if not empty.any():
            return points, filled
        low, high = self.voxel_raster.preprocessing.height
        points, filled = points.clone(), filled.clone()
        points[empty, 0] = points.new_tensor([0.0, 0.0, (low + high) / 2, 0.0])
        filled[empty, 0] = True
        return points, filled

    def _keypoints(self, points: Tensor, filled: Tensor) -> Tensor:
        """The first points (b, keypoints, 3) of each scan, again from the first where it ends."""
        number = torch.arange(self.voxel_raster.keypoints, device=points.device)
        rows = number % filled.sum(dim=1, keepdim=True)
        return points.gather(1, rows[..., None].expand(-1, -1, 3))

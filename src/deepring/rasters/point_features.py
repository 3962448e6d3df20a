"""A fixed number of points per scan, each with features of its neighbourhood: LPD-Net's input."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring.rasters.adaptive_features import (
    ADAPTIVE_FEATURES,
    SIZES,
    adaptive_features,
    check_sizes,
    scaled,
)
from deepring.rasters.base import Raster
from deepring.rasters.downsample import at_most, spread
from deepring.rasters.points import check_cloud, turned_points, within
from deepring.rasters.preprocessing import Preprocessing


@dataclass(frozen=True)
class PointFeaturesRaster(Raster, kind="point_features"):
    """LPD-Net's input: ``count`` points in [-1, 1] and ten features of each, (count, 13) float16.

    The points are those of a `PointsRaster`. The features are `adaptive_features`' among them, each
    but the last scaled over the cloud to [0, 1] (Liu et al. 2019; Suoivy/LPD-net). Points are
    repeated afterwards, so that repetitions are no neighbours. A scan without points gives zeros.

    Args:
        count: points.
        extent: metres by which coordinates are divided, and beyond which no point is kept.
        neighbours: the sizes of neighbourhoods that each point chooses from.

    >>> PointFeaturesRaster(count=512).shape
    (512, 13)
    """

    count: int = 4096
    extent: float = 70.0
    neighbours: Sequence[int] = SIZES
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("point", "xyz and features")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        check_cloud(self, self.count, self.extent)
        sizes = check_sizes("raster.neighbours", self.neighbours)
        object.__setattr__(self, "neighbours", tuple(sizes.tolist()))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points, and 13 for x, y, z and the features."""
        return (self.count, 3 + len(ADAPTIVE_FEATURES))

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Points in units of ``extent`` with their features, (count, 13) float16."""
        cloud = at_most(within(points, self.extent), self.count)
        if not len(cloud):
            return np.zeros(self.shape, dtype=np.float16)
        features = scaled(adaptive_features(cloud, self.neighbours))
        rows = np.column_stack([cloud / self.extent, features]).astype(np.float16)
        return rows[spread(len(rows), self.count)]

    @property
    def sectors(self) -> int:
        """360: points can be turned by any angle, and whole degrees suffice."""
        return 360

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Points (n, count, 13) turned about z by ``sectors`` (n,) degrees; features stay."""
        points = turned_points(images[..., :3], sectors * (2 * torch.pi / self.sectors))
        return torch.cat([points, images[..., 3:]], dim=-1)

"""A fixed number of points per scan, in no particular order: PointNetVLAD's input."""

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.downsample import fixed_count
from deepring.rasters.preprocessing import Preprocessing


@dataclass(frozen=True)
class PointsRaster(Raster, kind="points"):
    """PointNetVLAD's input: ``count`` points in [-1, 1], (count, 3) float16.

    Points beyond the disc of ``extent`` metres are dropped, as in the BEV, and all three
    coordinates are divided by ``extent``: z = 1 is ``extent`` above the ground, and shapes keep
    their proportions. The original (Uy and Lee 2018, Sec. 5) moves submaps of 20 m to their
    centroid and scales them to a mean distance of 0.5; here the sensor stays the origin, and the
    scale is the same for all scans. A scan without points gives zeros. The rounding error is at
    most 1.7 cm at 70 m and 9 mm below 35 m. `deepring.rasters.downsample` fixes the count.

    >>> points = np.array([[35.0, 0.0, 7.0]], dtype=np.float32)
    >>> PointsRaster(count=2, preprocessing=Preprocessing(clearance=None))(points, ground_z=0.0)
    array([[0.5, 0. , 0.1],
           [0.5, 0. , 0.1]], dtype=float16)
    """

    count: int = 4096
    extent: float = 70.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("point", "xyz")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        check_cloud(self, self.count, self.extent)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points, and 3 for x, y, z."""
        return (self.count, 3)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Points in units of ``extent``, (count, 3) float16, z above the ground."""
        near = within(points, self.extent)
        return (fixed_count(near, self.count) / self.extent).astype(np.float16)

    @property
    def sectors(self) -> int:
        """360: points can be turned by any angle, and whole degrees suffice."""
        return 360

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Points (n, count, 3) turned about z by ``sectors`` (n,) degrees, counter-clockwise."""
        return turned_points(images, sectors * (2 * math.pi / self.sectors))


def within(points: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """The points (n, 3) less than ``radius`` metres from the z axis, (m, 3).

    >>> within(np.array([[3.0, 4.0, 99.0], [6.0, 8.0, 0.0]], dtype=np.float32), radius=6)
    array([[ 3.,  4., 99.]], dtype=float32)
    """
    return points[np.hypot(points[:, 0], points[:, 1]) < radius]


def turned_points(points: Tensor, turn: Tensor) -> Tensor:
    """Points (n, count, 3) turned about z by ``turn`` (n,) radians, counter-clockwise."""
    x, y, z = points.float().unbind(-1)
    c, s = turn.float().cos()[:, None], turn.float().sin()[:, None]
    return torch.stack([c * x - s * y, s * x + c * y, z], dim=-1).to(points.dtype)


def check_cloud(raster: Raster, count: int, extent: float) -> None:
    """Raise ConfigError unless a raster of ``count`` points can scale them by ``extent``."""
    checks.count("raster.count", count, most=2**17)
    raster.check_lengths("extent")
    raster.check_reach(extent)
    low, high = raster.preprocessing.height
    if max(-low, high) > extent:
        raise ConfigError(
            f"preprocessing.height: {[low, high]}, expected heights within ±{extent:g} m, the "
            f"raster.extent by which the {type(raster).__name__} scales z into [-1, 1]"
        )

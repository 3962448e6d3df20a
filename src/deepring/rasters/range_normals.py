"""Ranges and normals in each direction, and the overlap of two scans (OverlapNet, RSS 2020)."""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.highest import whole_scan
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, finite_coordinates

Normals = Literal["sensor", "radial"]
"""The axes of normals: the sensor's x, y and z; or outward, to the left and up in each sector."""


@dataclass(frozen=True)
class RangeNormalRaster(Raster, kind="range_normals"):
    """The nearest return in each direction and its surface: (4, sectors, rows) float16.

    Channel 0 is the range in metres, the others are the unit normal, which looks at the sensor; -1
    in all of them stands for nothing. Rows are equal parts of ``elevation`` seen from ``viewpoint``
    metres above the ground, lowest first; the lowest has no normals. Points from ``max_range`` on
    do not count. In the published image columns go clockwise, and rows from the top.

    A turn of the scan turns the normals of the sensor's axes. 'radial' ones, which are ours, stay
    as they are.

    >>> RangeNormalRaster().shape
    (4, 900, 64)
    """

    sectors: int = 900  # equal parts of θ
    rows: int = 64  # equal parts of the elevation
    elevation: tuple[float, float] = (-25.0, 3.0)  # degrees, lowest and highest
    viewpoint: float = 1.73
    max_range: float = 50.0
    normals: Normals = "sensor"  # in the axes of the sensor, or radial, of each direction
    preprocessing: Preprocessing = field(default_factory=whole_scan)

    axes = ("channel", "theta", "elevation")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("sectors", "rows")
        self.check_lengths("max_range")
        self.check_reach(self.max_range)
        checks.between("raster.viewpoint", self.viewpoint, -FARTHEST, FARTHEST, "metres")
        checks.one_of("raster.normals", self.normals, Normals)
        low, high = checks.interval("raster.elevation", self.elevation, "degrees")
        if low < -90 or high > 90:
            raise ConfigError(
                f"raster.elevation: {[low, high]}, expected [low, high] degrees in [-90, 90]"
            )
        object.__setattr__(self, "elevation", (low, high))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Channels, sectors and rows of elevation."""
        return (4, self.sectors, self.rows)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Ranges and normals."""
        from deepring.rasters import _range_normal_kernels as _kernels

        ranges = np.zeros(self.shape[1:], dtype=np.float32)
        nearest = np.zeros((*self.shape[1:], 3))
        flat, bounds = finite_coordinates(points), self._bounds
        _kernels.nearest_points(flat, self.viewpoint, *bounds, self.max_range, ranges, nearest)
        image = np.full(self.shape, -1.0, dtype=np.float32)
        image[0][ranges > 0] = ranges[ranges > 0]
        _kernels.normals(ranges, nearest, self.normals == "radial", image[1:])
        return image.astype(np.float16)

    def is_blank(self, image: NDArray[Any]) -> bool:
        """Whether there is no return at all."""
        return not bool((image[0] > 0).any())

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """See `Raster.turned`; normals of the sensor's axes are turned too."""
        rolled = super().turned(images, sectors)
        if self.normals == "radial":
            return rolled
        turn = (sectors * (2 * math.pi / self.sectors))[:, None, None]
        c, s = turn.cos(), turn.sin()
        x, y = rolled[:, 1].float(), rolled[:, 2].float()
        known = (rolled[:, 1:] != -1).any(dim=1)  # (-1, -1, -1) is no unit vector
        for channel, values in ((1, c * x - s * y), (2, s * x + c * y)):
            rolled[:, channel] = torch.where(known, values.to(rolled.dtype), rolled[:, channel])
        return rolled

    def overlaps(
        self,
        ranges: NDArray[np.floating],
        pairs: NDArray[np.int64],
        poses: NDArray[np.float64],
        tolerance: float = 1.0,
        around: int = 1,
    ) -> NDArray[np.float64]:
        """How much of the first scan of each pair the second one sees too, (p,) in [0, 1].

        The share of the first's ranges to which one of the second comes within ``tolerance``
        metres, in the same cell or up to ``around`` cells beside it, once the second's points are
        carried over; 0 where the first has none. The published code carries all points of a scan
        and looks at the same cell alone. Here points are taken to be in the middle of their cells,
        which is off by up to half a cell on either side.

        Args:
            ranges: (n, sectors, rows), channel 0 of rasters.
            pairs: (p, 2) numbers of scans.
            poses: (p, 4, 4) rigid, each carries the second's points onto the first's.
            tolerance: metres.
            around: cells.
        """
        from deepring.rasters import _range_normal_kernels as _kernels

        out = np.zeros(len(pairs))
        images = np.ascontiguousarray(ranges, dtype=np.float32)
        given = np.ascontiguousarray(pairs, dtype=np.int64), np.ascontiguousarray(poses)
        _kernels.overlaps(images, *given, *self._bounds, self.max_range, tolerance, around, out)
        return out

    @property
    def _bounds(self) -> tuple[float, float]:
        low, high = self.elevation
        return math.radians(low), math.radians(high)

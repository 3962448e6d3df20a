"""The histogram of ranges: how many points lie how far (Röhling et al., IROS 2015)."""

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, finite_coordinates


@dataclass(frozen=True)
class HistogramRaster(Raster, kind="histogram"):
    """Shares of the points in buckets of range, (buckets,) float32 of sum 1; zeros for no points.

    Ranges are measured in space, from ``viewpoint`` metres above the ground, where the sensor is
    taken to be. Points outside ``span``, [nearest, farthest) metres, do not count at all. The
    ground stays in, unless ``preprocessing`` takes it out.

    >>> HistogramRaster().shape
    (100,)
    """

    buckets: int = 100  # equal parts of the span
    span: tuple[float, float] = (0.0, 80.0)
    viewpoint: float = 1.73
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(-5.0, 100.0), clearance=None, extent=80.0)
    )

    axes = ("range",)
    dtype = np.dtype(np.float32)

    def __post_init__(self) -> None:
        self.check_counts("buckets")
        checks.between("raster.viewpoint", self.viewpoint, -FARTHEST, FARTHEST, "metres")
        low, high = checks.interval("raster.span", self.span, "metres")
        checks.between("raster.span", low, 0, FARTHEST, "metres")
        object.__setattr__(self, "span", (low, high))
        self.check_reach(high)

    @property
    def shape(self) -> tuple[int]:
        """Buckets."""
        return (self.buckets,)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Shares."""
        return range_histogram(points, self.buckets, self.span, self.viewpoint)

    @property
    def sectors(self) -> int:
        """360: no turn changes the ranges."""
        return 360

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:  # noqa: ARG002
        """The histograms (n, buckets) as they are."""
        return torch.clone(images)


def range_histogram(
    points: NDArray[np.float32],
    buckets: int = 100,
    span: tuple[float, float] = (0.0, 80.0),
    viewpoint: float = 0.0,
) -> NDArray[np.float32]:
    """The share of the points in each bucket of range, (buckets,) float32.

    Bucket i holds ranges in [low + i w, low + (i + 1) w), w = (high - low) / buckets.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        buckets: number of buckets, of equal width.
        span: (low, high) metres; points of other ranges do not count.
        viewpoint: height of the origin of ranges above the ground, metres.

    >>> points = np.array([[1.5, 0, 0], [0, 2.5, 0], [0, 0, 9.5], [99, 0, 0]], dtype=np.float32)
    >>> (3 * range_histogram(points, buckets=5, span=(0, 10))).round().tolist()
    [1.0, 1.0, 0.0, 0.0, 1.0]
    """
    low, high = span
    rows = finite_coordinates(points).reshape(-1, 3).astype(np.float64)
    ranges = np.sqrt(rows[:, 0] ** 2 + rows[:, 1] ** 2 + (rows[:, 2] - viewpoint) ** 2)
    counted = ranges[(ranges >= low) & (ranges < high)]
    # A range just below the end may round into the bucket after the last.
    bucket = np.minimum((counted - low) / (high - low) * buckets, buckets - 1).astype(np.int64)
    counts = np.bincount(bucket, minlength=buckets)
    return (counts / max(1, len(counted))).astype(np.float32)

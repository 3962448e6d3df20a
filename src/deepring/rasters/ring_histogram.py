"""Histograms of ranges, one for each ring of a LiDAR (LocNet: Yin et al., IV 2018)."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, finite_coordinates

RingFeature = Literal["range", "difference"]
"""What is counted: ranges of points, or distances between consecutive points of a ring."""


@dataclass(frozen=True)
class RingHistogramRaster(Raster, kind="ring_histogram"):
    """A histogram for each ring: (rows, buckets) float16 shares, each row of sum 1, or of zeros.

    Rings are equal parts of ``elevation``, seen from ``viewpoint`` metres above the ground, lowest
    first. ``feature`` 'range' counts the points' distances from the sensor's axis; 'difference'
    the distances, seen from above, between the points of a ring that follow each other in azimuth,
    the last and the first among them. Values outside ``span``, metres, do not count at all; both
    its ends are outside. The ground stays in. No turn of the scan changes anything.

    The published code takes rings from the order of the points in the file, which is lost once
    points are removed or moved, and skips the first point of each ring.

    >>> RingHistogramRaster().shape
    (64, 80)
    """

    rows: int = 64  # rings
    buckets: int = 80  # equal parts of the span
    span: tuple[float, float] = (1.0, 81.0)
    feature: RingFeature = "range"
    elevation: tuple[float, float] = (-25.0, 3.0)  # degrees, lowest and highest
    viewpoint: float = 1.73
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(-1.27, 100.0), clearance=None, extent=81.0)
    )

    axes = ("elevation", "range")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("rows", "buckets")
        checks.one_of("raster.feature", self.feature, RingFeature)
        checks.between("raster.viewpoint", self.viewpoint, -FARTHEST, FARTHEST, "metres")
        low, high = checks.interval("raster.span", self.span, "metres")
        checks.between("raster.span", low, 0, FARTHEST, "metres")
        object.__setattr__(self, "span", (low, high))
        lowest, highest = checks.interval("raster.elevation", self.elevation, "degrees")
        if lowest < -90 or highest > 90:
            raise ConfigError(
                f"raster.elevation: {[lowest, highest]}, expected [low, high] degrees in [-90, 90]"
            )
        object.__setattr__(self, "elevation", (lowest, highest))
        if self.feature == "range":
            self.check_reach(high)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows of elevation and buckets."""
        return (self.rows, self.buckets)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Shares."""
        shares = ring_histograms(
            *(points, self.rows, self.buckets, self.span),
            *(self.feature, self.elevation, self.viewpoint),
        )
        return shares.astype(np.float16)

    @property
    def sectors(self) -> int:
        """360: no turn changes the histograms."""
        return 360

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:  # noqa: ARG002
        """The histograms (n, rows, buckets) as they are."""
        return torch.clone(images)


def ring_histograms(
    points: NDArray[np.float32],
    rows: int = 64,
    buckets: int = 80,
    span: tuple[float, float] = (1.0, 81.0),
    feature: RingFeature = "range",
    elevation: tuple[float, float] = (-25.0, 3.0),
    viewpoint: float = 0.0,
) -> NDArray[np.float32]:
    """Shares of ranges or of differences in each ring, (rows, buckets) float32.

    Bucket i holds values in [low + i w, low + (i + 1) w), w = (high - low) / buckets, but for low
    itself, which is outside.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        rows: number of rings.
        buckets: number of buckets, of equal width.
        span: (low, high) metres.
        feature: what is counted, see `RingFeature`.
        elevation: lowest and highest elevation, degrees.
        viewpoint: height of the sensor above the ground, metres.

    >>> points = np.array([[3.2, 0, 0], [0, 3.7, 0], [-10.5, 0, 0], [0, -0.9, 0]], dtype=np.float32)
    >>> image = ring_histograms(points, rows=1)
    >>> np.flatnonzero(image).tolist(), image[image > 0].astype(float).round(2).tolist()
    ([2, 9], [0.67, 0.33])
    """
    x, y, z = finite_coordinates(points).reshape(-1, 3).astype(np.float64).T
    across = np.hypot(x, y)
    lowest, highest = (math.radians(angle) for angle in elevation)
    place = (np.arctan2(z - viewpoint, across) - lowest) / (highest - lowest) * rows
    seen = (place >= 0) & (place < rows)
    ring = place[seen].astype(np.int64)
    if feature == "range":
        values = across[seen]
    else:
        ring, values = _differences(x[seen], y[seen], ring)
    low, high = span
    counted = (values > low) & (values < high)
    # A value just below the end may round into the bucket after the last.
    bucket = np.minimum((values[counted] - low) / (high - low) * buckets, buckets - 1)
    cells = ring[counted] * buckets + bucket.astype(np.int64)
    counts = np.bincount(cells, minlength=rows * buckets).reshape(rows, buckets)
    return (counts / np.maximum(1, counts.sum(axis=1, keepdims=True))).astype(np.float32)


def _differences(
    x: NDArray[np.float64], y: NDArray[np.float64], ring: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The ring of each point, in the order of rings and azimuths, and metres to the next in it."""
    order = np.lexsort((np.hypot(x, y), np.arctan2(y, x), ring))
    x, y, ring = x[order], y[order], ring[order]
    first = np.searchsorted(ring, ring, side="left")
    following = np.arange(1, len(ring) + 1)
    last = np.append(ring[1:] != ring[:-1], True)[: len(ring)]
    following[last] = first[last]
    return ring, np.hypot(x[following] - x, y[following] - y)

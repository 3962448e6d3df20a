"""A scan as segments: what stands apart from the rest, as Locus takes it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Integer, UInt8
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError, DataError
from deepring.rasters.base import Raster
from deepring.rasters.clusters import euclidean_clusters
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.segment_shape import (
    aligned,
    hull_distances,
    hull_points,
    voxels,
)

#: Bytes of the centre and of the extents of a segment: 3 numbers each.
_CENTRE = _EXTENTS = 12

_FLOAT = np.dtype("<f4")


class Segments(NamedTuple):
    """The segments of b scans, at most s each."""

    present: Bool[Tensor, "b s"]
    """(b, s) bool: whether a row holds a segment; the first rows do."""
    bits: UInt8[Tensor, "b s byte"]
    """(b, s, cells / 8) uint8: its voxels, see `unpack_voxels`."""
    centres: Float[Tensor, "b s 3"]
    """(b, s, 3) float32 metres: the mean of its points, z above the ground."""
    extents: Float[Tensor, "b s 3"]
    """(b, s, 3) float32 metres along its own axes."""
    distances: Float[Tensor, "b s s"]
    """(b, s, s) float32 metres between the hulls of two segments; infinite where one lacks."""


@dataclass(frozen=True)
class SegmentsRaster(Raster, kind="segments"):
    """The segments of a scan: (max_segments, bytes) uint8, see `segments`.

    Segments are `euclidean_clusters` of ``least_points`` to ``most_points`` points of what the
    preprocessing leaves: the ground has to be gone. A row is a segment: its occupied ``cells`` as
    bits, centre, extents, and its distances from the segments of all rows. Of more than
    ``max_segments``, those of the most points remain; they come first. Rows after the last
    segment hold infinite distances and zeros, so that a scan in which nothing is a segment is not
    blank: it is described, by zeros. Only a scan without points is blank.

    The order of the points does not matter.

    >>> SegmentsRaster().shape
    (64, 2328)
    """

    max_segments: int = 64
    cells: tuple[int, int, int] = (32, 32, 16)
    smallest_voxel: float = 0.1  # metres; larger segments have larger voxels
    tolerance: float = 0.2  # metres between neighbours of one segment
    growth: float = 0.0  # of the tolerance with the range: metres for each metre
    least_points: int = 100
    most_points: int = 15_000
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("segment", "byte")
    dtype = np.dtype(np.uint8)

    def __post_init__(self) -> None:
        checks.count("raster.max_segments", self.max_segments, most=1024)
        cells = tuple(checks.count("raster.cells", n, 4, 256) for n in self.cells)
        if len(cells) != 3 or any(n % 4 for n in cells):
            raise ConfigError(
                f"raster.cells: {list(self.cells)}, expected three numbers that 4 divides"
            )
        object.__setattr__(self, "cells", cells)
        self.check_lengths("smallest_voxel", "tolerance")
        checks.between("raster.growth", self.growth, 0, 10, "metres for each metre of range")
        checks.count("raster.least_points", self.least_points)
        checks.count("raster.most_points", self.most_points, self.least_points)

    @property
    def shape(self) -> tuple[int, int]:
        """Segments, and bytes of each."""
        distances = _FLOAT.itemsize * self.max_segments
        return (self.max_segments, self._bits + _CENTRE + _EXTENTS + distances)

    @property
    def _bits(self) -> int:
        """Bytes of the voxels of a segment."""
        return int(np.prod(self.cells)) // 8

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Rows of the segments of points (n, 3), the ground left out."""
        image = np.zeros(self.shape, dtype=np.uint8)
        if not len(points):
            return image
        parts = self._parts(points[np.lexsort(points.T)])
        distances = np.full((self.max_segments,) * 2, np.inf, dtype=_FLOAT)
        distances[: len(parts), : len(parts)] = hull_distances([hull_points(p) for p in parts])
        image[:, self._bits + _CENTRE + _EXTENTS :] = distances.view(np.uint8)
        for row, part in zip(image, parts, strict=False):
            grid, extents = voxels(aligned(part), self.cells, self.smallest_voxel)
            numbers = np.concatenate([part.mean(axis=0, dtype=np.float64), extents])
            row[: self._bits] = np.packbits(grid)
            row[self._bits : self._bits + _CENTRE + _EXTENTS] = numbers.astype(_FLOAT).view(
                np.uint8
            )
        return image

    def _parts(self, points: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """The points of each segment, the segment of the most points first."""
        cluster = euclidean_clusters(points, self.tolerance, self.growth)
        counts = np.bincount(cluster)
        counted = np.flatnonzero((counts >= self.least_points) & (counts <= self.most_points))
        largest = counted[np.argsort(-counts[counted], kind="stable")][: self.max_segments]
        order = np.argsort(cluster, kind="stable")
        starts = np.cumsum(counts) - counts
        return [points[order[starts[k] : starts[k] + counts[k]]] for k in largest]

    def segments(self, rasters: Integer[Tensor, "b s byte"]) -> Segments:
        """What rasters (b, max_segments, bytes) hold.

        Raises DataError where they are not those of this kind.
        """
        rows = rasters.to(torch.uint8)
        if rasters.dtype != torch.uint8 and not torch.equal(rows.to(rasters.dtype), rasters):
            raise DataError("rasters: numbers beyond 0 to 255, expected bytes")
        sizes = [self._bits, _CENTRE, _EXTENTS, _FLOAT.itemsize * self.max_segments]
        bits, *numbers = torch.split(rows, sizes, dim=-1)
        centres, extents, distances = (part.contiguous().view(torch.float32) for part in numbers)
        present = (bits != 0).any(dim=-1)
        both = present[..., None] & present[..., None, :]
        distances = distances.masked_fill(~both, torch.inf)
        for part in (centres, extents, distances.masked_fill(~both, 0.0)):
            if not bool(part.isfinite().all()) or bool((part.abs() > _LARGEST).any()):
                raise DataError(
                    "rasters: numbers that are no metres, expected what a SegmentsRaster makes of "
                    "a scan"
                )
        return Segments(present, bits, centres, extents, distances)


#: Metres that no scan reaches.
_LARGEST = 1e6


def unpack_voxels(
    bits: UInt8[Tensor, "n byte"], cells: tuple[int, int, int]
) -> UInt8[Tensor, "n x y z"]:
    """Occupancy (n, *cells) uint8, 0 or 1, of bits (n, cells / 8), the first the highest.

    >>> bits = torch.tensor([[128, 0, 0, 0, 0, 0, 0, 1]], dtype=torch.uint8)
    >>> unpack_voxels(bits, (4, 4, 4)).nonzero().tolist()
    [[0, 0, 0, 0], [0, 3, 3, 3]]
    """
    shifts = torch.arange(7, -1, -1, dtype=torch.uint8, device=bits.device)
    return ((bits[..., None] >> shifts) & 1).reshape(len(bits), *cells)

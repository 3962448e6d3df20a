"""Ranges of what stands in each direction, by class or by height (RINet: Li et al., RA-L 2022)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.classes import CLASSES, classes_of
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, contiguous_points, coordinates
from deepring.rasters.semantic import Labelled, all_points

#: The classes that have a channel, in the order of RINet's published code.
CHANNELS = (
    *("car", "road", "parking", "sidewalk", "other ground", "building", "fence", "vegetation"),
    *("trunk", "terrain", "pole", "traffic sign"),
)

#: Channel of each of `CLASSES`, or -1.
_CHANNEL = np.array(
    [CHANNELS.index(name) if name in CHANNELS else -1 for name in CLASSES], dtype=np.int8
)

#: Of these channels the farthest point counts.
_FARTHEST = np.array([name == "road" for name in CHANNELS])


@dataclass(frozen=True)
class SemanticRangesRaster(Labelled, Raster, kind="semantic_ranges"):
    """How far each class is in each direction: (sectors, 12) float16 ranges over ``radius``.

    The range, seen from above, is that of the nearest point of the class in the sector, for the
    road that of the farthest; 0 stands for none. The classes are `CHANNELS`; moving cars count as
    cars. Points beyond ``radius`` metres do not count.

    >>> points = np.array([[5, 0, 0, 40], [20, 0, 0, 40], [5, 0, 1, 50], [20, 0, 1, 50]])
    >>> image = SemanticRangesRaster()(points, ground_z=0.0)
    >>> image[0, [1, 5]].astype(float).round(2).tolist()  # farthest road, nearest building
    [0.4, 0.1]
    """

    sectors: int = 360  # equal parts of θ
    radius: float = 50.0
    preprocessing: Preprocessing = field(default_factory=all_points)

    axes = ("theta", "channel")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_disc("sectors")

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and classes."""
        return (self.sectors, len(CHANNELS))

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Ranges over ``radius`` of points (n, 4): x, y, z, label."""
        channel = _CHANNEL[classes_of(points[:, 3])]
        return channel_ranges(points, channel, _FARTHEST, self.radius, self.sectors)


@dataclass(frozen=True)
class HeightRangesRaster(Raster, kind="height_ranges"):
    """How far what stands at each height is in each direction: (sectors, bands) float16.

    The same as `SemanticRangesRaster` without classes: in place of a class, a point has one of
    ``bands`` bands of ``height``, [low, high) metres above the ground, and the nearest counts.

    >>> HeightRangesRaster().shape
    (360, 12)
    """

    sectors: int = 360  # equal parts of θ
    bands: int = 12
    height: tuple[float, float] = (0.0, 6.0)
    radius: float = 50.0  # metres
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("theta", "channel")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("sectors", "bands")
        checks.count("raster.bands", self.bands, most=127)
        height = checks.interval("raster.height", self.height, "metres")
        for end in height:
            checks.between("raster.height", end, -FARTHEST, FARTHEST, "metres")
        object.__setattr__(self, "height", height)
        self.check_lengths("radius")
        self.check_reach(self.radius)

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and bands."""
        return (self.sectors, self.bands)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Ranges over ``radius``."""
        low, high = self.height
        band = np.floor((points[:, 2].astype(np.float64) - low) / (high - low) * self.bands)
        channel = np.where((band >= 0) & (band < self.bands), band, -1).astype(np.int8)
        nearest = np.zeros(self.bands, dtype=np.bool_)
        return channel_ranges(points, channel, nearest, self.radius, self.sectors)


def channel_ranges(
    points: NDArray[np.float32],
    channel: NDArray[np.int8],
    farthest: NDArray[np.bool_],
    radius: float = 50.0,
    sectors: int = 360,
) -> NDArray[np.float16]:
    """The range of each channel in each direction over ``radius``, (sectors, channels) float16.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x: a turn of the scan
    by +2π / sectors shifts the rows by +1. The published code has azimuths from -π.

    Args:
        points: (n, >=3) float32, metres, finite.
        channel: (n,) number of each point's channel, or -1.
        farthest: (channels,): the farthest point counts, not the nearest.
        radius: metres beyond which points do not count.
        sectors: number of rows, over the full turn.
    """
    from deepring.rasters import _channel_kernels

    ranges = np.zeros((sectors, len(farthest)), dtype=np.float32)
    flat = coordinates(contiguous_points(points))
    _channel_kernels.channel_ranges(flat, channel, farthest, radius, ranges)
    return (ranges / np.float32(radius)).astype(np.float16)

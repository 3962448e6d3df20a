"""LiDAR-Iris' image: which heights are occupied, as bits, in each polar cell (Wang et al. 2020)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.base import Raster
from deepring.rasters.highest import whole_scan
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, finite_coordinates

#: Layers of height: the bits of a byte.
BITS = 8


@dataclass(frozen=True)
class IrisRaster(Raster, kind="iris"):
    """Occupied layers of height: (sectors, rings) uint8.

    Bit k is set where a point lies in the layer that ends ``low`` + k metres above the sensor,
    which is taken to be ``viewpoint`` metres above the ground. Layers are a metre high; the lowest
    one also holds what is below, the highest one what is above. The ground stays in, unless
    ``preprocessing`` takes it out.

    >>> IrisRaster().shape
    (360, 80)
    """

    sectors: int = 360  # equal parts of θ
    rings: int = 80  # equal parts of the radius
    radius: float = 80.0  # metres
    low: float = -5.0
    viewpoint: float = 1.73
    preprocessing: Preprocessing = field(default_factory=whole_scan)

    axes = ("theta", "r")
    dtype = np.dtype(np.uint8)

    def __post_init__(self) -> None:
        self.check_counts("sectors", "rings")
        self.check_lengths("radius")
        for name in ("low", "viewpoint"):
            value = checks.number(f"raster.{name}", getattr(self, name), "metres")
            checks.between(f"raster.{name}", value, -FARTHEST, FARTHEST, "metres")
        self.check_reach(self.radius)

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and rings."""
        return (self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Bits of the occupied layers."""
        return occupied_layers(
            points, self.radius, self.sectors, self.rings, self.low + self.viewpoint
        )


def occupied_layers(
    points: NDArray[np.float32],
    radius: float = 80.0,
    sectors: int = 360,
    rings: int = 80,
    low: float = -5.0,
) -> NDArray[np.uint8]:
    """The layers of height that hold a point, as bits, of each polar cell: (sectors, rings) uint8.

    Row k is centred on the azimuth -π + 2π k / sectors, counter-clockwise: a turn of the scan by
    +2π / sectors shifts the rows by +1. Points beyond ``radius`` are in the last ring. A point at
    z sets bit ⌈z - low⌉, or the nearest of the `BITS`.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        radius: outer radius, metres.
        sectors: number of rows, over the full turn.
        rings: number of columns, of equal width.
        low: height where the lowest layer ends, metres above the ground.

    >>> image = occupied_layers(np.array([[10.5, 0.2, -1.7]], dtype=np.float32))
    >>> np.argwhere(image).tolist(), int(image.max())
    ([[181, 10]], 16)
    """
    rows = finite_coordinates(points).reshape(-1, 3).astype(np.float64)
    turn = (np.arctan2(rows[:, 1], rows[:, 0]) + np.pi) / (2 * np.pi)
    sector = np.floor(turn * sectors + 0.5).astype(np.int64) % sectors
    ring = np.minimum(np.hypot(rows[:, 0], rows[:, 1]) / radius * rings, rings - 1)
    bit = np.clip(np.ceil(rows[:, 2] - low), 0, BITS - 1)
    occupied = np.zeros(sectors * rings * BITS, dtype=np.bool_)
    occupied[(sector * rings + ring.astype(np.int64)) * BITS + bit.astype(np.int64)] = True
    return np.packbits(occupied, bitorder="little").reshape(sectors, rings)

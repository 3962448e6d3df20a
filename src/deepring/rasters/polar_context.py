"""Scan Context++'s polar context (Kim, Choi and Kim, T-RO 2022)."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.highest import check_grid, highest, images, whole_scan
from deepring.rasters.preprocessing import FARTHEST, Preprocessing


@dataclass(frozen=True)
class PolarContextRaster(Raster, kind="polar_context"):
    """Largest height in each polar cell, from several origins: (origins, sectors, rings) float16.

    Args:
        sectors, rings, radius: polar cells to ``radius`` metres; what is beyond is in the last
            ring.
        least: points without which a cell is empty.
        grid: side of the cubes, metres, whose points are averaged first; None takes all points.
        sideways: metres to the left of the sensor of each origin; the first is the scan itself.

    >>> PolarContextRaster(sideways=(0.0, 2.0, -2.0)).shape
    (3, 60, 20)
    """

    sectors: int = 60
    rings: int = 20
    radius: float = 80.0
    least: int = 5
    grid: float | None = 0.5
    sideways: Sequence[float] = (0.0,)
    preprocessing: Preprocessing = field(default_factory=whole_scan)

    axes = ("origin", "theta", "r")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_disc("sectors", "rings", "least")
        check_grid(self.grid)
        origins = self.sideways
        if not isinstance(origins, list | tuple) or not origins or origins[0] != 0:
            raise ConfigError(
                f"raster.sideways: {origins!r}, expected a list of metres of which the first is 0, "
                "the sensor's own place"
            )
        for metres in origins:
            aside = checks.number("raster.sideways", metres, "metres")
            checks.between("raster.sideways", aside, -FARTHEST, FARTHEST, "metres")
        object.__setattr__(self, "sideways", tuple(float(metres) for metres in origins))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Origins, sectors and rings."""
        return (len(self.sideways), self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Largest heights."""
        return images(points, self.grid, self.context, [(1.0, y) for y in self.sideways])

    def context(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """`polar_context` of these cells."""
        return polar_context(points, self.radius, self.sectors, self.rings, self.least)

    def turned(self, images: torch.Tensor, sectors: torch.Tensor) -> torch.Tensor:
        """The contexts of turned scans. Raises ConfigError for several origins.

        They stand to the side of the sensor, which a turn takes elsewhere.
        """
        if len(self.sideways) > 1:
            raise ConfigError(
                f"raster.sideways: {len(self.sideways)} origins, expected one where scans are "
                "turned; or leave the scans unturned"
            )
        return super().turned(images, sectors)


def polar_context(
    points: NDArray[np.floating],
    radius: float = 80.0,
    sectors: int = 60,
    rings: int = 20,
    least: int = 5,
) -> NDArray[np.float32]:
    """Largest height in each polar cell, (sectors, rings) float32; an empty cell is 0.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x. Points beyond the
    radius are in the last ring. Cells with less than ``least`` points are empty, and heights below
    0 count as 0.

    Args:
        points: (n, 3), metres, z above the ground.
        radius: outer radius, metres.
        sectors: number of rows, over the full turn.
        rings: number of columns, of equal width.
        least: points without which a cell is empty.

    >>> points = np.array([[30.0, 1.0, 2.0], [30.0, 1.0, 5.0], [1.0, 1.0, 9.0]])
    >>> polar_context(points, radius=40, sectors=2, rings=4, least=2).tolist()
    [[0.0, 0.0, 0.0, 5.0], [0.0, 0.0, 0.0, 0.0]]
    """
    x, y, z = points.T
    turn = (np.arctan2(y, x) / (2 * np.pi)) % 1.0
    sector = (turn * sectors).astype(np.int64) % sectors
    ring = np.minimum(np.hypot(x, y) / radius * rings, rings - 1).astype(np.int64)
    return highest(sector * rings + ring, z, (sectors, rings), least)

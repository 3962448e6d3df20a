"""The polar gram P_f(r, θ): occupancy over polar cells (paper, Sec. III-A, Eq. 4)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import Preprocessing, finite_coordinates


@dataclass(frozen=True)
class PolarRaster(Raster, kind="polar"):
    """The polar gram: (sectors, rings) bool.

    >>> PolarRaster(sectors=60, rings=20).shape
    (60, 20)
    """

    sectors: int = 120  # equal parts of θ
    rings: int = 120  # equal parts of the radius
    radius: float = 70.0  # metres
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("theta", "r")
    dtype = np.dtype(np.bool_)

    def __post_init__(self) -> None:
        self.check_disc("sectors", "rings")

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and rings."""
        return (self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Occupied cells."""
        return polar_gram(points, self.radius, self.sectors, self.rings)


def polar_gram(
    points: NDArray[np.float32], radius: float = 70.0, sectors: int = 120, rings: int = 120
) -> NDArray[np.bool_]:
    """Occupancy over polar cells P_f(θ, r): (sectors, rings) bool.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x: a turn of the scan
    by +2π / sectors shifts the rows by +1.

    Args:
        points: (n, 3) float32, metres.
        radius: outer radius, metres.
        sectors: number of rows, over the full turn.
        rings: number of columns, of equal width.

    >>> points = np.array([[0.0, 30.0, 1.0]], dtype=np.float32)  # to the left
    >>> np.argwhere(polar_gram(points, radius=40, sectors=8, rings=4))
    array([[2, 3]])
    """
    from deepring.rasters import _polar_kernels

    image = np.full((sectors, rings), -np.inf, dtype=np.float32)
    _polar_kernels.polar_highest(finite_coordinates(points), radius, image)
    return image > -np.inf

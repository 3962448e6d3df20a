"""Scan Context's height map (Kim and Kim, IROS 2018; irapkaist/scancontext)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import Preprocessing, finite_coordinates


@dataclass(frozen=True)
class ContextRaster(Raster, kind="context"):
    """Largest height in each polar cell: (sectors, rings) float16, precise to 8 mm at 10 m.

    >>> ContextRaster().shape
    (60, 20)
    """

    sectors: int = 60  # equal parts of θ
    rings: int = 20  # equal parts of the radius
    radius: float = 80.0  # metres
    preprocessing: Preprocessing = field(
        default_factory=lambda: Preprocessing(height=(-2.0, 100.0), clearance=None, extent=80.0)
    )

    axes = ("theta", "r")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_disc("sectors", "rings")

    @property
    def shape(self) -> tuple[int, int]:
        """Sectors and rings."""
        return (self.sectors, self.rings)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Largest heights."""
        return scan_context(points, self.radius, self.sectors, self.rings).astype(np.float16)


def scan_context(
    points: NDArray[np.float32], radius: float = 80.0, sectors: int = 60, rings: int = 20
) -> NDArray[np.float32]:
    """Largest height in each polar cell, (sectors, rings) float32; an empty cell is 0.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x: a turn of the scan
    by +2π / sectors shifts the rows by +1. Source: irapkaist/scancontext, which stores the
    transpose. Heights below 0 count as 0.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        radius: outer radius, metres.
        sectors: number of rows, over the full turn.
        rings: number of columns, of equal width.

    >>> points = np.array([[30.0, 1.0, 2.0], [30.0, 1.0, 5.0]], dtype=np.float32)
    >>> scan_context(points, radius=40, sectors=2, rings=4)
    array([[0., 0., 0., 5.],
           [0., 0., 0., 0.]], dtype=float32)
    """
    from deepring.rasters import _polar_kernels

    image = np.zeros((sectors, rings), dtype=np.float32)
    _polar_kernels.polar_highest(finite_coordinates(points), radius, image)
    return image

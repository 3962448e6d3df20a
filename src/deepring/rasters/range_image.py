"""The range image: nearest return in each direction (paper, Sec. III-A)."""

import math

import numpy as np
from numpy.typing import NDArray


def range_image(
    points: NDArray[np.float32],
    sectors: int = 120,
    rows: int = 32,
    elevation: tuple[float, float] = (-25.0, 30.0),
    viewpoint: float = 1.8,
    max_range: float = 80.0,
) -> NDArray[np.float32]:
    """Closeness 1 - range / max_range, (sectors, rows) float32 in [0, 1]; no return is 0.

    Row k covers azimuths 2π [k, k + 1) / sectors, counter-clockwise from x: a turn of the scan
    by +2π / sectors shifts the rows by +1.

    Args:
        points: (n, 3) float32, metres, z above the ground.
        sectors: azimuths over the whole turn.
        rows: elevations, the lowest first.
        elevation: lowest and highest elevation, degrees.
        viewpoint: height above the ground from which ranges are taken, metres.
        max_range: metres.
    """
    from deepring.rasters import _polar_kernels

    nearest = np.full((sectors, rows), max_range, dtype=np.float32)
    low, high = (math.radians(angle) for angle in elevation)
    points = np.ascontiguousarray(points)
    _polar_kernels.nearest_return(points, viewpoint, sectors, rows, low, high, nearest)
    return np.float32(1.0) - nearest / np.float32(max_range)

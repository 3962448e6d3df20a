"""Polar images: the polar gram (paper, Sec. III-A), in layers, and Scan Context's height map."""

import numpy as np
from numpy.typing import NDArray


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
        sectors: rows, over the whole turn.
        rings: columns, of equal width.
    """
    from deepring.rasters import _polar_kernels

    image = np.zeros((sectors, rings), dtype=np.float32)
    _polar_kernels.polar_highest(np.ascontiguousarray(points), radius, sectors, rings, image)
    return image


def polar_gram(
    points: NDArray[np.float32], radius: float = 70.0, sectors: int = 120, rings: int = 120
) -> NDArray[np.bool_]:
    """Occupancy over polar cells P_f(θ, r), (sectors, rings) bool; rows as in `scan_context`."""
    from deepring.rasters import _polar_kernels

    image = np.full((sectors, rings), -np.inf, dtype=np.float32)
    _polar_kernels.polar_highest(np.ascontiguousarray(points), radius, sectors, rings, image)
    return image > -np.inf


def polar_layers(
    points: NDArray[np.float32],
    radius: float = 70.0,
    height: tuple[float, float] = (2.0, 20.0),
    shape: tuple[int, int, int] = (20, 120, 40),
) -> NDArray[np.bool_]:
    """Occupancy over polar cells in layers of height, (layers, sectors, rings) bool.

    Sectors as in `scan_context`, on axis -2. Source: DiSCO (Xu et al. 2021, Sec. III-A).

    Args:
        points: (n, 3) float32, metres, z above the ground.
        radius: outer radius, metres.
        height: [low, high) that the layers share equally, metres; the lowest comes first.
        shape: layers, sectors and rings.
    """
    from deepring.rasters import _polar_kernels

    image = np.zeros(shape, dtype=np.bool_)
    low, high = height
    _polar_kernels.polar_layers(np.ascontiguousarray(points), radius, low, high, image)
    return image

"""What both contexts of Scan Context++ share: averaged points, and the largest height of a cell."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.rasters.downsample import LARGEST, SMALLEST, voxel_means
from deepring.rasters.preprocessing import Preprocessing, finite_coordinates


def whole_scan() -> Preprocessing:
    """A crop that keeps all that a LiDAR sees, ground and all."""
    return Preprocessing(height=(-50.0, 150.0), clearance=None, extent=200.0)


def check_grid(grid: float | None) -> None:
    """Raise ConfigError unless the grid is None or metres that `voxel_means` takes."""
    if grid is not None:
        length = checks.positive("raster.grid", grid, "metres")
        checks.between("raster.grid", length, SMALLEST, LARGEST, "metres")


def images(
    points: NDArray[np.float32],
    grid: float | None,
    context: Callable[[NDArray[np.float64]], NDArray[np.float32]],
    frames: Sequence[tuple[float, float]],
) -> NDArray[np.float16]:
    """The contexts of a scan whose x and y are taken times a sign, from an origin ``y`` aside."""
    points = finite_coordinates(points).reshape(-1, 3)
    cloud = points.astype(np.float64)
    if grid is not None and len(points):
        cloud = voxel_means(points, grid)
    moved = [cloud * [sign, sign, 1.0] - [0.0, aside, 0.0] for sign, aside in frames]
    return np.stack([context(each) for each in moved]).astype(np.float16)


def highest(
    cell: NDArray[np.int64], heights: NDArray[np.floating], shape: tuple[int, int], least: int
) -> NDArray[np.float32]:
    """The largest of the heights (n,) in each flat cell, 0 where there are less than ``least``."""
    image = np.zeros(shape[0] * shape[1], dtype=np.float32)
    np.maximum.at(image, cell, heights.astype(np.float32))
    image[np.bincount(cell, minlength=len(image)) < least] = 0.0
    return image.reshape(shape)

"""Crop and ground removal: from a raw scan to the points that distinguish places."""

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.arrays import real_array
from deepring.errors import ConfigError, DataError

#: Metres from a sensor to the farthest points that anybody asks for.
FARTHEST = 10_000

#: Cells along a side of the ground's grid.
_MOST_CELLS = 4096


@dataclass(frozen=True)
class Preprocessing:
    """Crops a scan. Heights are metres above the nominal ground under the sensor.

    Points outside the band ``height`` or beyond ``extent`` are dropped, and those less than
    ``clearance`` above the local ground, the lowest point within ``window`` x ``window`` cells of
    ``cell`` metres. None for ``clearance`` uses the band alone, as RING's published code does (1
    to 20 m). The local minimum also works on a tilted platform: at 3° a flat floor rises 3.7 m
    over 70 m.

    >>> points = np.array([[5, 0, -1.7], [6, 0, 0.3]], dtype=np.float32)  # the ground, and a wall
    >>> Preprocessing(height=(1.0, 20.0), clearance=None)(points, ground_z=-1.7)
    array([[6., 0., 2.]], dtype=float32)
    """

    height: tuple[float, float] = (-5.0, 20.0)  # metres above the nominal ground
    clearance: float | None = 0.5  # metres above the local ground; None: the band alone
    window: int = 5  # cells along a side, odd, in which the lowest point is the ground
    cell: float = 140.0 / 120  # metres
    extent: float = 70.0  # metres from the sensor

    def __post_init__(self) -> None:
        height = checks.interval("preprocessing.height", self.height, "metres")
        for end in height:
            checks.between("preprocessing.height", end, -FARTHEST, FARTHEST, "metres")
        object.__setattr__(self, "height", height)
        if checks.count("preprocessing.window", self.window, most=999) % 2 == 0:
            raise ConfigError(f"preprocessing.window: {self.window}, expected an odd number")
        if self.clearance is not None:
            checks.between("preprocessing.clearance", self.clearance, 0, FARTHEST, "metres")
        for name in ("cell", "extent"):
            length = checks.positive(f"preprocessing.{name}", getattr(self, name), "metres")
            checks.between(f"preprocessing.{name}", length, 0, FARTHEST, "metres")
        if 2 * self.extent / self.cell > _MOST_CELLS:
            raise ConfigError(
                f"preprocessing.cell: {self.cell:g} m, expected at least 1/{_MOST_CELLS} of the "
                f"{2 * self.extent:g} m across"
            )

    @property
    def side(self) -> int:
        """Cells per side of the ground's grid."""
        # One spare cell keeps rounding at the far border inside.
        return math.ceil(2 * self.extent / self.cell) + 1

    def __call__(self, points: Any, ground_z: float) -> NDArray[np.float32]:
        """Cropped points (m, 3), z above the nominal ground, of a scan (n, >=3) in its frame.

        ``points`` is anything like an array of real numbers; points that are not finite in float32
        are dropped. ``ground_z`` is the z of the ground under the sensor in the scan's frame
        (metres). Raises DataError for other points, and ConfigError for another ``ground_z``.
        """
        from deepring.rasters import _bev_kernels as _kernels

        ground_z = checked_ground(ground_z)
        low, high = (height + ground_z for height in self.height)
        points = contiguous_points(points)
        crop = np.empty((len(points) + 1, 3), dtype=np.float32)
        if self.clearance is None:
            count = _kernels.in_box(points, self.extent, low, high, crop)
        else:
            flat, side = coordinates(points), self.side
            cells = np.empty(len(points), dtype=np.uint32)
            _kernels.ground_cells(flat, self.extent, low, high, self.cell, side, cells)
            floor = self.floor(flat, cells)
            count = _kernels.keep_above(flat, cells, floor, np.float32(self.clearance), crop)
        crop = crop[:count]
        crop[:, 2] -= np.float32(ground_z)
        return crop

    def rows(self, points: Any, ground_z: float) -> NDArray[np.int64]:
        """Which of the points (n, >=3) a call keeps, (m,) in their order."""
        from deepring.rasters import _bev_kernels as _kernels

        ground_z = checked_ground(ground_z)
        low, high = (height + ground_z for height in self.height)
        flat = coordinates(contiguous_points(points))
        rows = np.empty(len(flat) // 3 + 1, dtype=np.int64)
        if self.clearance is None:
            count = _kernels.rows_in_box(flat.reshape(-1, 3), self.extent, low, high, rows)
        else:
            cells = np.empty(len(flat) // 3, dtype=np.uint32)
            _kernels.ground_cells(flat, self.extent, low, high, self.cell, self.side, cells)
            floor = self.floor(flat, cells)
            count = _kernels.rows_above(flat, cells, floor, np.float32(self.clearance), rows)
        return rows[:count]

    def floor(self, flat: NDArray[np.float32], cells: NDArray[np.uint32]) -> NDArray[np.float32]:
        """Height of the local ground (side² + 1,) in each flat cell of the grid.

        ``cells`` are those of the points ``flat`` (3 n,). Dropped points are in the cell after the
        last, whose ground is infinitely high.
        """
        from deepring.rasters import _bev_kernels as _kernels

        lowest = np.full(self.side**2 + 1, np.inf, dtype=np.float32)
        _kernels.lower(flat, cells, lowest)
        grid = lowest[:-1].reshape(self.side, self.side)
        grid[:] = _kernels.minimum_filter(grid, self.window)
        lowest[-1] = np.inf
        return lowest


def coordinates(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """x, y, z of points (n, >=3) one after the other, (3 n,)."""
    return np.ascontiguousarray(points[:, :3]).reshape(-1)


def finite_coordinates(points: Any) -> NDArray[np.float32]:
    """`coordinates` of the points that are finite, of whatever `contiguous_points` takes."""
    flat = coordinates(contiguous_points(points))
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(flat.sum()):
            return flat
    rows = flat.reshape(-1, 3)
    return rows[np.isfinite(rows).all(axis=1)].reshape(-1)


def contiguous_points(points: Any, least: int = 3) -> NDArray[np.float32]:
    """Points as contiguous float32 (n, >=least), of anything like an array of real numbers.

    Beyond float32 they are infinite. Raises DataError for anything else, and for another shape.
    """
    array = real_array("points", points)
    if array.ndim != 2 or array.shape[1] < least:
        raise DataError(f"points: shape {array.shape}, expected (n, {least})")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, dtype=np.float32)


def checked_ground(ground_z: Any) -> float:
    """z of the ground, metres. Raises ConfigError unless it is a finite number."""
    real = isinstance(ground_z, Real) and not isinstance(ground_z, bool | np.bool_)
    return checks.number("ground_z", float(ground_z) if real else ground_z, "metres")

"""Scan Context++'s Cartesian context (Kim, Choi and Kim, T-RO 2022)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.highest import check_grid, highest, images, whole_scan
from deepring.rasters.preprocessing import Preprocessing


@dataclass(frozen=True)
class CartContextRaster(Raster, kind="cart_context"):
    """Largest height in each cell across and along the way: (headings, across, along) float16.

    Cells are ``width`` metres across and ``length`` metres along the sensor's x axis, counted from
    the sensor. See `PolarContextRaster` for ``least`` and ``grid``. With ``reverse`` a second
    context is that of the scan turned by half a turn.

    >>> CartContextRaster(reverse=True).shape
    (2, 40, 40)
    """

    across: int = 40  # cells
    along: int = 40  # cells
    width: float = 2.0  # metres
    length: float = 5.0  # metres
    least: int = 1  # points without which a cell is empty
    #: side of cubes whose points are averaged first, metres; None takes all points
    grid: float | None = 0.5
    reverse: bool = False
    preprocessing: Preprocessing = field(default_factory=whole_scan)

    axes = ("heading", "across", "along")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("across", "along", "least")
        self.check_lengths("width", "length")
        for name in ("across", "along"):
            if getattr(self, name) % 2:
                raise ConfigError(f"raster.{name}: {getattr(self, name)}, expected an even number")
        self.check_reach(max(self.across * self.width, self.along * self.length) / 2)
        check_grid(self.grid)
        checks.of_type("raster.reverse", self.reverse, bool)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Headings, cells across and cells along."""
        return (1 + self.reverse, self.across, self.along)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Largest heights."""
        headings = [(1.0, 0.0), (-1.0, 0.0)][: 1 + self.reverse]
        return images(points, self.grid, self.context, headings)

    def context(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """`cart_context` of these cells."""
        cells = (self.across, self.along)
        return cart_context(points, cells, (self.width, self.length), self.least)


def cart_context(
    points: NDArray[np.floating],
    cells: tuple[int, int] = (40, 40),
    size: tuple[float, float] = (2.0, 5.0),
    least: int = 1,
) -> NDArray[np.float32]:
    """Largest height in each cell, (across, along) float32; an empty cell is 0.

    As in the published code, the sensor is in the middle cell, whose number is half the count, and
    the distance from the sensor counts in whole cells to either side: the cells around 0 are twice
    as wide, and the first row and column stay empty. Points outside do not count.

    Args:
        points: (n, 3), metres, x forward and y to the left, z above the ground.
        cells: numbers of cells across (y) and along (x), even.
        size: of a cell across and along, metres.
        least: points without which a cell is empty.

    >>> image = cart_context(np.array([[-5.1, -2.1, 3.0]]))
    >>> np.argwhere(image).tolist()
    [[19, 19]]
    """
    middle = np.array(cells) // 2
    steps = points[:, [1, 0]] / np.array(size)
    inside = (np.abs(steps) < middle).all(axis=1)
    place = np.trunc(steps[inside]).astype(np.int64) + middle
    return highest(place[:, 0] * cells[1] + place[:, 1], points[inside, 2], cells, least)

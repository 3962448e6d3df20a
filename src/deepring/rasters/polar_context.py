"""Scan Context++'s polar and Cartesian contexts (Kim, Choi and Kim, T-RO 2022)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.downsample import LARGEST, SMALLEST, voxel_means
from deepring.rasters.preprocessing import FARTHEST, Preprocessing, finite_coordinates


def _whole_scan() -> Preprocessing:
    return Preprocessing(height=(-50.0, 150.0), clearance=None, extent=200.0)


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
    preprocessing: Preprocessing = field(default_factory=_whole_scan)

    axes = ("origin", "theta", "r")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("sectors", "rings", "least")
        self.check_lengths("radius")
        self.check_reach(self.radius)
        _check_grid(self)
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
        return _images(points, self.grid, self.context, [(1.0, y) for y in self.sideways])

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


@dataclass(frozen=True)
class CartContextRaster(Raster, kind="cart_context"):
    """Largest height in each cell across and along the way: (headings, across, along) float16.

    Cells are ``width`` metres across and ``length`` metres along the sensor's x axis, counted from
    the sensor. See `PolarContextRaster` for ``least`` and ``grid``. With ``reverse`` a second
    context is that of the scan turned by half a turn.

    >>> CartContextRaster(reverse=True).shape
    (2, 40, 40)
    """

    across: int = 40
    along: int = 40
    width: float = 2.0
    length: float = 5.0
    least: int = 1
    grid: float | None = 0.5
    reverse: bool = False
    preprocessing: Preprocessing = field(default_factory=_whole_scan)

    axes = ("heading", "across", "along")
    dtype = np.dtype(np.float16)

    def __post_init__(self) -> None:
        self.check_counts("across", "along", "least")
        self.check_lengths("width", "length")
        for name in ("across", "along"):
            if getattr(self, name) % 2:
                raise ConfigError(f"raster.{name}: {getattr(self, name)}, expected an even number")
        self.check_reach(max(self.across * self.width, self.along * self.length) / 2)
        _check_grid(self)
        checks.of_type("raster.reverse", self.reverse, bool)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Headings, cells across and cells along."""
        return (1 + self.reverse, self.across, self.along)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float16]:
        """Largest heights."""
        headings = [(1.0, 0.0), (-1.0, 0.0)][: 1 + self.reverse]
        return _images(points, self.grid, self.context, headings)

    def context(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """`cart_context` of these cells."""
        cells = (self.across, self.along)
        return cart_context(points, cells, (self.width, self.length), self.least)


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
    return _highest(sector * rings + ring, z, (sectors, rings), least)


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
    return _highest(place[:, 0] * cells[1] + place[:, 1], points[inside, 2], cells, least)


def _check_grid(raster: PolarContextRaster | CartContextRaster) -> None:
    if raster.grid is not None:
        raster.check_lengths("grid")
        checks.between("raster.grid", raster.grid, SMALLEST, LARGEST, "metres")


def _images(
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


def _highest(
    cell: NDArray[np.int64], heights: NDArray[np.floating], shape: tuple[int, int], least: int
) -> NDArray[np.float32]:
    """The largest of the heights (n,) in each flat cell, 0 where there are less than ``least``."""
    image = np.zeros(shape[0] * shape[1], dtype=np.float32)
    np.maximum.at(image, cell, heights.astype(np.float32))
    image[np.bincount(cell, minlength=len(image)) < least] = 0.0
    return image.reshape(shape)

"""Bird's-eye occupancy images (paper, Sec. III-A; RING, lus6-Jenny/RING)."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.rasters.base import Raster
from deepring.rasters.preprocessing import (
    Preprocessing,
    checked_ground,
    contiguous_points,
    coordinates,
)


@dataclass(frozen=True)
class BevRaster(Raster, kind="bev"):
    """Occupancy from above, masked to the inscribed disc: (cells, cells) bool.

    >>> BevRaster(cells=40).shape
    (40, 40)
    """

    cells: int = 120  # along a side
    extent: float = 70.0  # metres, half a side
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("x", "y")
    dtype = np.dtype(np.bool_)

    def __post_init__(self) -> None:
        self.check_counts("cells")
        self.check_lengths("extent")
        self.check_reach(self.extent)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along x and y."""
        return (self.cells, self.cells)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Occupied cells (cells, cells) bool."""
        return bev_occupancy(points, self.extent, self.cells)

    def __call__(self, points: Any, ground_z: float) -> NDArray[np.bool_]:
        """Occupied cells of a whole scan, in one pass over its points."""
        return scan_to_bev(points, ground_z, self.preprocessing, self.extent, self.cells)


def bev_occupancy(
    points: NDArray[np.float32], extent: float = 70.0, cells: int = 120, *, disc: bool = True
) -> NDArray[np.bool_]:
    """Occupied cells seen from above: (cells, cells) bool, indexed [x, y].

    Cell [i, j] covers x in [i, i + 1) * size - extent, and y likewise, size = 2 extent / cells
    metres: x forward grows along the first axis, y left along the second. With ``disc`` cells
    outside the inscribed disc are cleared, since a turn moves the corners out of the image.

    Args:
        points: (n, >=2) float32, metres.
        extent: half the side, metres.
        cells: cells per side.
        disc: mask to the inscribed disc.

    >>> points = np.array([[25.0, -5.0, 1.0]], dtype=np.float32)  # forward, to the right
    >>> np.argwhere(bev_occupancy(points, extent=40, cells=8))
    array([[6, 3]])
    """
    from deepring.rasters import _bev_kernels

    image = np.zeros((cells, cells), dtype=np.uint8)
    _bev_kernels.occupancy(contiguous_points(points, 2), extent, cells, image)
    occupied = image.view(np.bool_)
    if disc:
        occupied &= disc_mask(cells)
    return occupied


def scan_to_bev(
    points: NDArray[np.float32],
    ground_z: float,
    preprocessing: Preprocessing,
    extent: float = 70.0,
    cells: int = 120,
) -> NDArray[np.bool_]:
    """``bev_occupancy(preprocessing(points, ground_z), extent, cells)``, several times faster.

    Marks the cell of each point without copying points. Returns (cells, cells) bool.

    >>> points = np.array([[25.0, -5.0, 1.0], [0.0, 0.0, -1.7]], dtype=np.float32)
    >>> above = Preprocessing(height=(1.0, 20.0), clearance=None)
    >>> np.argwhere(scan_to_bev(points, -1.7, above, extent=40, cells=8))
    array([[6, 3]])
    """
    from deepring.rasters import _bev_kernels

    flat = coordinates(contiguous_points(points))
    ground_z = checked_ground(ground_z)
    low, high = (height + ground_z for height in preprocessing.height)
    box = preprocessing.extent
    image = np.zeros(cells * cells + 1, dtype=np.uint8)  # the last cell is for points outside
    if preprocessing.clearance is None:
        _bev_kernels.band_occupancy(flat, box, low, high, extent, cells, image)
    else:
        side = preprocessing.side
        ground, pixels = np.empty((2, len(flat) // 3), dtype=np.uint32)
        _bev_kernels.two_cells(
            flat, box, low, high, preprocessing.cell, side, extent, cells, ground, pixels
        )
        floor = preprocessing.floor(flat, ground)
        clearance = np.float32(preprocessing.clearance)
        _bev_kernels.mark_above(flat, ground, pixels, floor, clearance, image)
    occupied = image[:-1].reshape(cells, cells).view(np.bool_)
    occupied &= disc_mask(cells)
    return occupied


@lru_cache(maxsize=16)
def disc_mask(cells: int) -> NDArray[np.bool_]:
    """The inscribed disc, (cells, cells) bool: cells whose centre projects onto a bin at any θ.

    >>> disc_mask(4).astype(int)
    array([[0, 0, 0, 0],
           [0, 1, 1, 0],
           [0, 1, 1, 0],
           [0, 0, 0, 0]])
    """
    offset = np.arange(cells) - (cells - 1) / 2
    mask: NDArray[np.bool_] = np.hypot(offset[:, None], offset[None, :]) <= (cells - 1) / 2
    mask.flags.writeable = False
    return mask

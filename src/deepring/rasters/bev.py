"""Bird's-eye occupancy images (paper, Sec. III-A; RING, lus6-Jenny/RING)."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


def bev_occupancy(
    points: NDArray[np.float32], extent: float = 70.0, cells: int = 120, *, disc: bool = True
) -> NDArray[np.bool_]:
    """Occupied cells seen from above: (cells, cells) bool, indexed [x, y].

    Cell [i, j] covers x in [i, i + 1) * size - extent, and y likewise, size = 2 extent / cells
    metres: x forward grows along the first axis, y left along the second. With ``disc`` cells
    outside the inscribed disc are cleared, since the corners leave the image in a turn.

    Args:
        points: (n, >=2) float32, metres.
        extent: half the side, metres.
        cells: cells a side.
        disc: mask to the inscribed disc.
    """
    from deepring.rasters import _bev_kernels as _kernels

    image = np.zeros((cells, cells), dtype=np.uint8)
    _kernels.occupancy(np.ascontiguousarray(points, dtype=np.float32), extent, cells, image)
    occupied = image.view(np.bool_)
    if disc:
        occupied &= disc_mask(cells)
    return occupied


@lru_cache(maxsize=16)
def disc_mask(cells: int) -> NDArray[np.bool_]:
    """The inscribed disc, (cells, cells) bool: cells whose centre projects onto a bin at any θ."""
    offset = np.arange(cells) - (cells - 1) / 2
    mask: NDArray[np.bool_] = np.hypot(offset[:, None], offset[None, :]) <= (cells - 1) / 2
    mask.flags.writeable = False
    return mask

"""Clouds thinned to one point in each voxel."""

import numpy as np
from numpy.typing import NDArray

#: Side of a voxel, metres: less than any cell in which scans are compared, and 25 points a square
#: metre of a wall.
VOXEL = 0.2

#: Voxels along each axis, so that three indices fit into 63 bits.
_MOST = 1 << 21


def thinned(points: NDArray[np.float32], voxel: float = VOXEL) -> NDArray[np.float32]:
    """The first point of each voxel, in the order of ``points`` (n, 3), metres.

    >>> points = np.array([[0.05, 0, 0], [0.15, 0, 0], [0.25, 0, 0]], dtype=np.float32)
    >>> thinned(points)[:, 0]
    array([0.05, 0.25], dtype=float32)
    """
    return points[first_rows(points, voxel)]


def first_rows(points: NDArray[np.floating], voxel: float) -> NDArray[np.int64]:
    """Rows (m,) of the first point of each voxel, ascending, of points (n, 3), metres.

    Voxels begin at the origin, so that parts of a cloud whose borders are on them can be thinned
    one by one.
    """
    cells = np.floor(points / np.float32(voxel)).astype(np.int64) + _MOST // 2
    keys = (cells[:, 0] * _MOST + cells[:, 1]) * _MOST + cells[:, 2]
    first = np.unique(keys, return_index=True)[1]
    first.sort()
    return first

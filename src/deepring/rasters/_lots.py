"""Points in lots, for the compiled loops over them (numba).

numba does not see changes here when it reuses what it compiled of a loop that calls this: delete
``__pycache__`` after an edit.
"""

import numpy as np
from numba import njit

#: Points that are taken at once: their coordinates, one after the other, stay in the first cache.
LOT = 2048


@njit(cache=True, nogil=True)
def room():
    """Memory for the coordinates of a lot, (3, LOT) float32."""
    return np.empty((3, LOT), np.float32)


@njit(cache=True, nogil=True)
def take(flat, start, lot):
    """x, y and z, each (m,), of the lot of points that begins with the point ``start``.

    The points lie one after the other in ``flat`` (3 n,); ``lot`` is the `room` that is taken up.
    Rows of a fixed width can be taken apart by vector instructions.
    """
    count = min(LOT, flat.shape[0] // 3 - start)
    xs, ys, zs = lot[0, :count], lot[1, :count], lot[2, :count]
    points = flat[3 * start : 3 * (start + count)]
    for k in range(count):
        xs[k], ys[k], zs[k] = points[3 * k], points[3 * k + 1], points[3 * k + 2]
    return xs, ys, zs

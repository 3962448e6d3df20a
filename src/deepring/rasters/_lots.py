"""Points in lots, for compiled loops over them (numba).

numba's cache of a calling loop does not notice changes in this file: delete ``__pycache__`` after
an edit.
"""

import numpy as np
from numba import njit

#: Points per lot; their coordinates fit into the processor's first cache.
LOT = 2048


@njit(cache=True, nogil=True)
def room():
    """Memory for the coordinates of a lot, (3, LOT) float32."""
    return np.empty((3, LOT), np.float32)


@njit(cache=True, nogil=True)
def take(flat, start, lot):
    """x, y and z, each (m,), of the lot that begins with point ``start`` of ``flat`` (3 n,).

    ``lot`` is memory from `room`; separate coordinates allow vector instructions.
    """
    count = min(LOT, flat.shape[0] // 3 - start)
    xs, ys, zs = lot[0, :count], lot[1, :count], lot[2, :count]
    points = flat[3 * start : 3 * (start + count)]
    for k in range(count):
        xs[k], ys[k], zs[k] = points[3 * k], points[3 * k + 1], points[3 * k + 2]
    return xs, ys, zs

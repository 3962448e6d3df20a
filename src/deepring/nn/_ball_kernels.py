"""Points around centres, compiled (numba)."""

from typing import no_type_check

import numpy as np
from numba import njit


@no_type_check
@njit(cache=True, nogil=True)
def spread_in_balls(centres, points, order, radius, rows):
    """Fill ``rows`` (m, k) with points (n, 3) evenly spread over those in each ball, else -1.

    ``order`` (n,) sorts the points by x; the sample of a ball is spread over that order.
    """
    found = np.empty(len(points), np.int64)
    x = points[order, 0]
    for c in range(len(centres)):
        cx, cy, cz = centres[c, 0], centres[c, 1], centres[c, 2]
        count = 0
        # One step more on either side than rounding could cost.
        at = np.searchsorted(x, np.float32(cx - radius * np.float32(1.0001)))
        while at < len(x) and x[at] <= cx + radius * np.float32(1.0001):
            k = order[at]
            dx, dy, dz = points[k, 0] - cx, points[k, 1] - cy, points[k, 2] - cz
            if dx * dx + dy * dy + dz * dz <= radius * radius:
                found[count] = k
                count += 1
            at += 1
        size = rows.shape[1]
        for j in range(size):
            rows[c, j] = found[j * count // size] if count else -1

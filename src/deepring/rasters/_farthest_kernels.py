"""Farthest-point sampling of one cloud, compiled (numba)."""

from typing import no_type_check

import numpy as np
from numba import njit


@no_type_check
@njit(cache=True, nogil=True)
def farthest(x, y, z, first, chosen):
    """Fill ``chosen`` (m,) with numbers of points, each the farthest from those before it.

    Begins with ``first``; of equally far points the first is taken, and none twice. x, y, z are
    (n,) float32, n at least m.
    """
    nearest = np.full(len(x), np.float32(np.inf), np.float32)
    last = first
    for k in range(len(chosen)):
        chosen[k] = last
        px, py, pz = x[last], y[last], z[last]
        for j in range(len(x)):  # vectorised: the search for the largest stands apart
            dx, dy, dz = x[j] - px, y[j] - py, z[j] - pz
            nearest[j] = min(nearest[j], dx * dx + dy * dy + dz * dz)
        nearest[last] = np.float32(-1)  # taken
        best = np.float32(-2)
        for j in range(len(x)):
            if nearest[j] > best:
                best, last = nearest[j], j

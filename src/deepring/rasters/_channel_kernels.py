"""Compiled CPU loops over the ranges of channels in sectors (numba). Imported on first use.

numba's cache does not notice changes in `_polar_kernels`: delete ``__pycache__`` after an edit.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from deepring.rasters._lots import LOT, room, take
from deepring.rasters._polar_kernels import polar_cells


@njit(cache=True, nogil=True)
@no_type_check
def channel_ranges(flat, channel, farthest, radius, out):
    """Set ``out`` (sectors, channels) float32 to the range of a point of each sector and channel.

    It is the nearest, or the farthest where ``farthest`` (channels,) is true; 0 stands for none.
    Points of a ``channel`` (n,) below 0 and beyond ``radius`` do not count.
    """
    sectors = out.shape[0]
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, _ = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, 1)
        for k in range(xs.shape[0]):
            c = channel[start + k]
            if ring[k] < 1 and c >= 0:
                distance = np.float32(np.sqrt(xs[k] * xs[k] + ys[k] * ys[k]))
                held = out[sector[k], c]
                if held == 0 or (distance > held if farthest[c] else distance < held):
                    out[sector[k], c] = distance

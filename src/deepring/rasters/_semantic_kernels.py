"""Compiled CPU loops over classes in polar cells (numba). Imported on first use.

numba's cache does not notice changes in `_polar_kernels`: delete ``__pycache__`` after an edit.
"""

import numpy as np
from numba import njit

from deepring.rasters._lots import LOT, room, take
from deepring.rasters._polar_kernels import polar_cells


@njit(cache=True, nogil=True)
def highest_priority(flat, priority, radius, out):
    """Raise ``out`` (sectors, rings) uint8 to the largest priority (n,) in each polar cell."""
    sectors, rings = out.shape
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, _ = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, rings)
        for k in range(xs.shape[0]):
            if ring[k] < rings and priority[start + k] > out[sector[k], ring[k]]:
                out[sector[k], ring[k]] = priority[start + k]


@njit(cache=True, nogil=True)
def first_of_highest(flat, priority, radius, out):
    """Set ``out`` (sectors, rings) int32 to the first point of the largest priority in each cell.

    Points of priority 0 do not count; a cell without any keeps its value, which is -1.
    """
    sectors, rings = out.shape
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, _ = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, rings)
        for k in range(xs.shape[0]):
            if ring[k] < rings and priority[start + k] > 0:
                best = out[sector[k], ring[k]]
                if best < 0 or priority[start + k] > priority[best]:
                    out[sector[k], ring[k]] = start + k


@njit(cache=True, nogil=True)
def point_of_sector(flat, counts, radius, nearest, out):
    """Set ``out`` (sectors,) int32 to a point of each sector: the nearest, or else the last.

    Only points where ``counts`` (n,) is true, within ``radius``; -1 where there is none.
    """
    sectors = out.shape[0]
    least = np.full(sectors, np.inf)
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, _ = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, 1)
        for k in range(xs.shape[0]):
            if ring[k] < 1 and counts[start + k]:
                x, y = np.float64(xs[k]), np.float64(ys[k])
                distance = x * x + y * y
                if not nearest or distance < least[sector[k]]:
                    least[sector[k]] = distance
                    out[sector[k]] = start + k

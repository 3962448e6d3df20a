"""Compiled CPU loops over polar cells (numba). Imported on first use.

Angles only determine the cell of a point. A polynomial, in a loop that compiles to vector
instructions, decides for all points except the few close to a border; for these the exact function
decides, so that the result is exact everywhere.
"""

import math

import numpy as np
from numba import njit

from deepring.rasters._lots import LOT, room, take

#: Bound on the error of `rough_angle`, radians; the largest error in tests is smaller.
_OFF = 2e-6


@njit(cache=True, nogil=True)
def rough_angle(y, x):
    """atan2(y, x) float32 to about a millionth: atan on [0, 1] by a Chebyshev fit of degree 13."""
    far, near = max(abs(x), abs(y)), min(abs(x), abs(y))
    a = near / max(far, np.float32(1e-30))
    s = a * a
    value = np.float32(0.0078254829)
    value = value * s + np.float32(-0.036898629)
    value = value * s + np.float32(0.083741557)
    value = value * s + np.float32(-0.13480406)
    value = value * s + np.float32(0.19879872)
    value = value * s + np.float32(-0.33326375)
    value = value * s + np.float32(0.99999933)
    value = value * a
    value = np.float32(math.pi / 2) - value if abs(y) > abs(x) else value
    value = np.float32(math.pi) - value if x < 0 else value
    return -value if y < 0 else value


@njit(cache=True, nogil=True)
def exact_sector(y, x, sectors):
    """Number of the sector, of equal sectors of the full turn, counter-clockwise from x."""
    turn = math.atan2(y, x) / (2.0 * math.pi)
    return int((turn - math.floor(turn)) * sectors) % sectors


@njit(cache=True, nogil=True)
def rough_sectors(xs, ys, sectors):
    """Sector of each point of a lot by the rough angle, and whether it is certain."""
    sector, sure = np.empty(xs.shape[0], np.int32), np.empty(xs.shape[0], np.bool_)
    count, width = np.float32(sectors), np.float32(sectors / (2.0 * math.pi))
    margin = np.float32(_OFF * sectors + 1e-6 * sectors)
    for k in range(xs.shape[0]):
        place = rough_angle(ys[k], xs[k]) * width
        place = place + count if place < 0 else place
        whole = np.int32(place)
        over = place - np.float32(whole)
        sector[k] = whole
        sure[k] = (over > margin) & (over < 1 - margin) & (whole < sectors)
    return sector, sure


@njit(cache=True, nogil=True)
def polar_cells(xs, ys, radius, sectors, rings):
    """Sector and ring of each point of a lot.

    Points beyond the last ring or with NaN get the ring ``rings`` and an arbitrary sector."""
    sector, sure = rough_sectors(xs, ys, sectors)
    ring = np.empty(xs.shape[0], np.int32)
    for k in range(xs.shape[0]):
        distance = math.sqrt(xs[k] * xs[k] + ys[k] * ys[k]) / radius * rings
        ring[k] = np.int32(distance) if distance < rings else np.int32(rings)
    for k in range(xs.shape[0]):
        if not sure[k] and ring[k] < rings:
            sector[k] = exact_sector(ys[k], xs[k], sectors)
    return sector, ring


@njit(cache=True, nogil=True)
def polar_highest(flat, radius, out):
    """Raise ``out`` (sectors, rings) float32 to the largest z of the points in each polar cell."""
    sectors, rings = out.shape
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, rings)
        for k in range(xs.shape[0]):
            if ring[k] < rings and zs[k] > out[sector[k], ring[k]]:
                out[sector[k], ring[k]] = zs[k]


@njit(cache=True, nogil=True)
def polar_layers(flat, radius, low, high, out):
    """Mark occupied cells in ``out`` (layers, sectors, rings) bool; layers divide [low, high)."""
    layers, sectors, rings = out.shape
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, radius, sectors, rings)
        for k in range(xs.shape[0]):
            layer = math.floor((zs[k] - low) / (high - low) * layers)
            if ring[k] < rings and 0 <= layer < layers:
                out[layer, sector[k], ring[k]] = True


#: Metres beyond any return. With rings of one metre up to here, only NaN is left out.
_BEYOND = 2**30


@njit(cache=True, nogil=True)
def nearest_return(flat, viewpoint, lowest, highest, out):
    """Lower ``out`` (sectors, rows) float32 to the smallest range in each direction."""
    sectors, rows = out.shape
    scale, base = np.float32(rows / (highest - lowest)), np.float32(lowest)
    margin = np.float32(2 * _OFF * rows / (highest - lowest) + 1e-6 * rows)
    heights, across = np.empty(LOT, np.float32), np.empty(LOT, np.float32)
    ranges, row = np.empty(LOT, np.float32), np.empty(LOT, np.int32)
    sure = np.empty(LOT, np.bool_)
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        sector, ring = polar_cells(xs, ys, float(_BEYOND), sectors, _BEYOND)
        for k in range(xs.shape[0]):
            z = zs[k] - viewpoint
            across[k], heights[k] = math.sqrt(xs[k] * xs[k] + ys[k] * ys[k]), z
            ranges[k] = math.sqrt(across[k] * across[k] + z * z)
        for k in range(xs.shape[0]):
            place = (rough_angle(heights[k], across[k]) - base) * scale
            whole = np.int32(math.floor(place))
            over = place - np.float32(whole)
            row[k] = whole
            sure[k] = (over > margin) & (over < 1 - margin)
        for k in range(xs.shape[0]):
            r = row[k]
            if not sure[k]:
                z = zs[k] - viewpoint
                r = math.floor((math.atan2(z, across[k]) - lowest) / (highest - lowest) * rows)
            if ring[k] < _BEYOND and 0 <= r < rows and ranges[k] < out[sector[k], r]:
                out[sector[k], r] = ranges[k]

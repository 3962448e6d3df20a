"""Compiled CPU loops over polar cells (numba). Imported on first use.

Angles are needed only to tell which cell a point is in. A polynomial tells it for all points but
those close to a border, in a loop that the compiler turns into vector instructions; these few are
asked for by the exact function, so that the result is the exact function's everywhere.
"""

import math

import numpy as np
from numba import njit

#: Points that are taken at once: their coordinates, one after the other, stay in the first cache.
_LOT = 2048

#: Radians by which `rough_angle` may be off; its largest error, found in tests, is less.
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
    """Which of equal sectors of the full turn, counter-clockwise from x."""
    turn = math.atan2(y, x) / (2.0 * math.pi)
    return int((turn - math.floor(turn)) * sectors) % sectors


@njit(cache=True, nogil=True)
def sectors_and_rings(lot, radius, sectors, rings, sector, ring, sure):
    """The polar cell of each point of a lot, and whether its sector is certain."""
    xs, ys = np.empty(_LOT, np.float32), np.empty(_LOT, np.float32)
    count, width = np.float32(sectors), np.float32(sectors / (2.0 * math.pi))
    margin = np.float32(_OFF * sectors + 1e-6 * sectors)
    for k in range(lot.shape[0]):
        xs[k], ys[k] = lot[k, 0], lot[k, 1]
    for k in range(lot.shape[0]):
        x, y = xs[k], ys[k]
        distance = math.sqrt(x * x + y * y) / radius * rings
        ring[k] = np.int32(distance) if distance < rings else np.int32(rings)
        place = rough_angle(y, x) * width
        place = place + count if place < 0 else place
        whole = np.int32(place)
        over = place - np.float32(whole)
        sector[k] = whole
        sure[k] = (over > margin) & (over < 1 - margin) & (whole < sectors)


@njit(cache=True, nogil=True)
def polar_highest(points, radius, sectors, rings, out):
    """Raise ``out`` (sectors, rings) float32 to the largest z of the points in each polar cell."""
    sector, ring = np.empty(_LOT, np.int32), np.empty(_LOT, np.int32)
    sure = np.empty(_LOT, np.bool_)
    for start in range(0, points.shape[0], _LOT):
        lot = points[start : start + _LOT]
        sectors_and_rings(lot, radius, sectors, rings, sector, ring, sure)
        for k in range(lot.shape[0]):
            if ring[k] >= rings:
                continue
            s = sector[k] if sure[k] else exact_sector(lot[k, 1], lot[k, 0], sectors)
            if lot[k, 2] > out[s, ring[k]]:
                out[s, ring[k]] = lot[k, 2]


@njit(cache=True, nogil=True)
def polar_layers(points, radius, low, high, out):
    """Mark in ``out`` (layers, sectors, rings) bool the polar cells of each layer of height that
    hold a point; the layers share [low, high)."""
    layers, sectors, rings = out.shape
    sector, ring = np.empty(_LOT, np.int32), np.empty(_LOT, np.int32)
    sure = np.empty(_LOT, np.bool_)
    for start in range(0, points.shape[0], _LOT):
        lot = points[start : start + _LOT]
        sectors_and_rings(lot, radius, sectors, rings, sector, ring, sure)
        for k in range(lot.shape[0]):
            layer = math.floor((lot[k, 2] - low) / (high - low) * layers)
            if ring[k] >= rings or not 0 <= layer < layers:
                continue
            s = sector[k] if sure[k] else exact_sector(lot[k, 1], lot[k, 0], sectors)
            out[layer, s, ring[k]] = True


@njit(cache=True, nogil=True)
def nearest_return(points, viewpoint, sectors, rows, lowest, highest, out):
    """Lower ``out`` (sectors, rows) float32 to the smallest range in each direction."""
    sector, ring = np.empty(_LOT, np.int32), np.empty(_LOT, np.int32)
    sure = np.empty(_LOT, np.bool_)
    heights, flats = np.empty(_LOT, np.float32), np.empty(_LOT, np.float32)
    ranges = np.empty(_LOT, np.float32)
    row, certain = np.empty(_LOT, np.int32), np.empty(_LOT, np.bool_)
    scale, base = np.float32(rows / (highest - lowest)), np.float32(lowest)
    margin = np.float32(2 * _OFF * rows / (highest - lowest) + 1e-6 * rows)
    for start in range(0, points.shape[0], _LOT):
        lot = points[start : start + _LOT]
        sectors_and_rings(lot, 1.0, sectors, 2**30, sector, ring, sure)
        for k in range(lot.shape[0]):
            x, y, z = lot[k, 0], lot[k, 1], lot[k, 2] - viewpoint
            flat = math.sqrt(x * x + y * y)
            flats[k], heights[k] = flat, z
            ranges[k] = math.sqrt(flat * flat + z * z)
        for k in range(lot.shape[0]):
            place = (rough_angle(heights[k], flats[k]) - base) * scale
            whole = np.int32(math.floor(place))
            over = place - np.float32(whole)
            row[k] = whole
            certain[k] = (over > margin) & (over < 1 - margin)
        for k in range(lot.shape[0]):
            r = row[k]
            if not certain[k]:
                z = lot[k, 2] - viewpoint
                r = math.floor((math.atan2(z, flats[k]) - lowest) / (highest - lowest) * rows)
            if not 0 <= r < rows:
                continue
            s = sector[k] if sure[k] else exact_sector(lot[k, 1], lot[k, 0], sectors)
            if ranges[k] < out[s, r]:
                out[s, r] = ranges[k]

"""Compiled CPU loops (numba). Imported on first use, so that the package starts quickly."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def occupancy(points, extent, cells, out):
    """Mark in ``out`` (cells, cells) uint8 the cells that hold a point of (n, >=2) float32."""
    scale = np.float32(cells / (2.0 * extent))
    half = np.float32(extent)
    for k in range(points.shape[0]):
        i = math.floor((points[k, 0] + half) * scale)
        j = math.floor((points[k, 1] + half) * scale)
        if 0 <= i < cells and 0 <= j < cells:
            out[i, j] = 1


# The loops over points write first and count afterwards: which points stay is as good as random
# to the processor, and a mispredicted branch costs more than a wasted store.


@njit(cache=True, nogil=True)
def in_box(points, extent, low, high, kept):
    """Copy the points with |x|, |y| < extent and low < z < high to the front of ``kept``
    (n + 1, 3); their number."""
    extent, low, high = np.float32(extent), np.float32(low), np.float32(high)
    count = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        kept[count, 0] = x
        kept[count, 1] = y
        kept[count, 2] = z
        count += int((abs(x) < extent) & (abs(y) < extent) & (z > low) & (z < high))
    return count


@njit(cache=True, nogil=True)
def lowest_point(points, half, cell, cells, lowest):
    """Note each point's flat cell in ``cells`` (n,) and lower ``lowest`` (side, side) to the
    smallest z in it. Each point must lie inside."""
    scale, half = np.float32(1.0 / cell), np.float32(half)
    side = lowest.shape[0]
    flat = lowest.ravel()
    for k in range(points.shape[0]):
        i = int((points[k, 0] + half) * scale)
        j = int((points[k, 1] + half) * scale)
        cells[k] = i * side + j
        if points[k, 2] < flat[cells[k]]:
            flat[cells[k]] = points[k, 2]


@njit(cache=True, nogil=True)
def keep_above(points, cells, floor, clearance):
    """Move the points that stand more than ``clearance`` above the floor of their flat cell to
    the front; their number."""
    flat = floor.ravel()
    count = 0
    for k in range(points.shape[0]):
        above = points[k, 2] > flat[cells[k]] + clearance
        points[count, 0] = points[k, 0]
        points[count, 1] = points[k, 1]
        points[count, 2] = points[k, 2]
        count += int(above)
    return count


@njit(cache=True, nogil=True)
def minimum_filter(image, window):
    """Smallest value in the ``window`` x ``window`` cells around each cell; borders cut it off."""
    size, reach = image.shape[0], window // 2
    rows, out = image.copy(), np.empty_like(image)
    for i in range(size):
        for m in range(max(0, i - reach), min(size, i + reach + 1)):
            for j in range(size):
                rows[i, j] = rows[i, j] if rows[i, j] < image[m, j] else image[m, j]
        out[i] = rows[i]
        for shift in range(1, reach + 1):
            for j in range(size - shift):
                ahead, behind = rows[i, j + shift], rows[i, j]
                out[i, j] = out[i, j] if out[i, j] < ahead else ahead
                out[i, j + shift] = out[i, j + shift] if out[i, j + shift] < behind else behind
    return out


@njit(cache=True, nogil=True)
def radon_half_turn(images, cosines, sines, bins, scale, out):
    """Pixel-driven Radon transform of (b, h, h) float32 into ``out`` (b, angles, bins).

    Coordinates are in cells from the image's centre; ``scale`` is τ bins a cell. Each occupied
    cell is projected to its τ and shared linearly between the two nearest bins.
    """
    size = images.shape[1]
    centre = np.float32((size - 1) / 2.0)
    middle = np.float32((bins + 1) / 2.0)
    last = np.float32(bins + 1)
    row = np.empty(bins + 2, np.float32)  # a spare bin on either side takes what falls off
    xs = np.empty(size * size, np.float32)
    ys = np.empty(size * size, np.float32)
    values = np.empty(size * size, np.float32)
    for b in range(images.shape[0]):
        count = 0
        for i in range(size):
            for j in range(size):
                if images[b, i, j] != 0:
                    xs[count] = (i - centre) * scale
                    ys[count] = (j - centre) * scale
                    values[count] = images[b, i, j] * scale
                    count += 1
        for a in range(cosines.shape[0]):
            c, s = cosines[a], sines[a]
            row[:] = 0.0
            for k in range(count):
                position = xs[k] * c + ys[k] * s + middle
                if 0.0 <= position < last:
                    lower = int(position)
                    upper_share = values[k] * (position - np.float32(lower))
                    row[lower] += values[k] - upper_share
                    row[lower + 1] += upper_share
            out[b, a] = row[1 : bins + 1]


@njit(cache=True, nogil=True)
def polar_highest(points, radius, sectors, rings, out):
    """Raise ``out`` (sectors, rings) float32 to the largest z of the points in each polar cell."""
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        ring = int(math.sqrt(x * x + y * y) / radius * rings)
        if ring >= rings:
            continue
        turn = math.atan2(y, x) / (2.0 * math.pi)
        sector = int((turn - math.floor(turn)) * sectors) % sectors
        if points[k, 2] > out[sector, ring]:
            out[sector, ring] = points[k, 2]


@njit(cache=True, nogil=True)
def polar_layers(points, radius, low, high, out):
    """Mark in ``out`` (layers, sectors, rings) bool the polar cells of each layer of height that
    hold a point; the layers share [low, high)."""
    layers, sectors, rings = out.shape
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        ring = int(math.sqrt(x * x + y * y) / radius * rings)
        layer = math.floor((points[k, 2] - low) / (high - low) * layers)
        if ring >= rings or not 0 <= layer < layers:
            continue
        turn = math.atan2(y, x) / (2.0 * math.pi)
        sector = int((turn - math.floor(turn)) * sectors) % sectors
        out[layer, sector, ring] = True


@njit(cache=True, nogil=True)
def nearest_return(points, viewpoint, sectors, rows, lowest, highest, out):
    """Lower ``out`` (sectors, rows) float32 to the smallest range in each direction."""
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2] - viewpoint
        flat = math.sqrt(x * x + y * y)
        row = math.floor((math.atan2(z, flat) - lowest) / (highest - lowest) * rows)
        if not 0 <= row < rows:
            continue
        turn = math.atan2(y, x) / (2.0 * math.pi)
        sector = int((turn - math.floor(turn)) * sectors) % sectors
        distance = np.float32(math.sqrt(flat * flat + z * z))
        if distance < out[sector, row]:
            out[sector, row] = distance

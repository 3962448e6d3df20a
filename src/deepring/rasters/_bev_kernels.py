"""Compiled CPU loops (numba). Imported on first use, so that the package starts quickly."""

import math

import numpy as np
from numba import njit

from deepring.rasters._lots import LOT, room, take


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


# The loops over points write first and count afterwards: branches here are unpredictable, and a
# mispredicted branch costs more than an unnecessary store.


@njit(cache=True, nogil=True)
def in_box(points, extent, low, high, out):
    """Copy points with |x|, |y| < extent and low < z < high to the front of ``out`` (n + 1, 3).

    Returns their number."""
    extent, low, high = np.float32(extent), np.float32(low), np.float32(high)
    count = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        out[count, 0] = x
        out[count, 1] = y
        out[count, 2] = z
        count += int((abs(x) < extent) & (abs(y) < extent) & (z > low) & (z < high))
    return count


@njit(cache=True, nogil=True)
def rows_in_box(points, extent, low, high, rows):
    """Write the numbers of the points of `in_box` to ``rows`` (n + 1,); return how many."""
    extent, low, high = np.float32(extent), np.float32(low), np.float32(high)
    count = 0
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        rows[count] = k
        count += int((abs(x) < extent) & (abs(y) < extent) & (z > low) & (z < high))
    return count


@njit(cache=True, nogil=True)
def lot_cells(xs, ys, zs, box, low, high, half, scale, side, cells):
    """Write the flat cell of each point of a lot into ``cells``.

    The grid has ``side`` x ``side`` cells, ``scale`` cells per metre, and starts at -half. Points
    outside it, or outside |x|, |y| < box and low < z < high, get the cell after the last."""
    box, low, high = np.float32(box), np.float32(low), np.float32(high)
    half, scale = np.float32(half), np.float32(scale)
    row, end, spare = np.int32(side), np.float32(side), np.int32(side * side)
    for k in range(cells.shape[0]):
        x, y, z = xs[k], ys[k], zs[k]
        u, v = (x + half) * scale, (y + half) * scale
        inside = (abs(x) < box) & (abs(y) < box) & (z > low) & (z < high)
        inside &= (u >= 0) & (u < end) & (v >= 0) & (v < end)
        cells[k] = np.uint32(np.int32(u) * row + np.int32(v) if inside else spare)


@njit(cache=True, nogil=True)
def band_occupancy(flat, box, low, high, extent, side, out):
    """`in_box` and `occupancy` at once: mark cells in ``out`` (side² + 1,) uint8, flat.

    Points outside |x|, |y| < box and low < z < high mark the last cell."""
    cells = np.empty(LOT, np.uint32)
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        part = cells[: xs.shape[0]]
        lot_cells(xs, ys, zs, box, low, high, extent, side / (2.0 * extent), side, part)
        for k in range(part.shape[0]):
            out[part[k]] = 1


@njit(cache=True, nogil=True)
def ground_cells(flat, box, low, high, cell, side, ground):
    """Write the flat cell of each point (n,) uint32 in the ground's grid, see `lot_cells`."""
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        part = ground[start : start + xs.shape[0]]
        lot_cells(xs, ys, zs, box, low, high, side * cell / 2, 1.0 / cell, side, part)


@njit(cache=True, nogil=True)
def two_cells(flat, box, low, high, cell, side, extent, image_side, ground, image):
    """`ground_cells`, and the same for the image's grid: (n,) uint32 each."""
    image_scale = image_side / (2.0 * extent)
    lot = room()
    for start in range(0, flat.shape[0] // 3, LOT):
        xs, ys, zs = take(flat, start, lot)
        end = start + xs.shape[0]
        lot_cells(xs, ys, zs, box, low, high, side * cell / 2, 1.0 / cell, side, ground[start:end])
        lot_cells(xs, ys, zs, box, low, high, extent, image_scale, image_side, image[start:end])


@njit(cache=True, nogil=True)
def keep_above(flat, ground, floor, clearance, out):
    """Copy points more than ``clearance`` above their floor to the front of ``out`` (n + 1, 3).

    Returns their number."""
    count = 0
    for k in range(ground.shape[0]):
        out[count, 0], out[count, 1] = flat[3 * k], flat[3 * k + 1]
        out[count, 2] = flat[3 * k + 2]
        count += int(flat[3 * k + 2] > floor[ground[k]] + clearance)
    return count


@njit(cache=True, nogil=True)
def rows_above(flat, ground, floor, clearance, rows):
    """Write the numbers of the points of `keep_above` to ``rows`` (n + 1,); return how many."""
    count = 0
    for k in range(ground.shape[0]):
        rows[count] = k
        count += int(flat[3 * k + 2] > floor[ground[k]] + clearance)
    return count


@njit(cache=True, nogil=True)
def lower(flat, cells, lowest):
    """Lower ``lowest``, flat, to the smallest z of the points in each cell."""
    for k in range(cells.shape[0]):
        z, least = flat[3 * k + 2], lowest[cells[k]]
        lowest[cells[k]] = z if z < least else least


@njit(cache=True, nogil=True)
def mark_above(flat, ground, image, floor, clearance, out):
    """Mark the image's cells of points more than ``clearance`` above the floor in ``out``, flat."""
    for k in range(ground.shape[0]):
        out[image[k]] |= np.uint8(flat[3 * k + 2] > floor[ground[k]] + clearance)


@njit(cache=True, nogil=True)
def minimum_filter(image, window):
    """Smallest value in the ``window`` x ``window`` cells around each cell, cut at the borders."""
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

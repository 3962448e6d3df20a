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


@njit(cache=True, nogil=True)
def lowest_point(points, extent, cells, out):
    """Lower ``out`` (cells, cells) float32 to the smallest z in each cell."""
    scale = np.float32(cells / (2.0 * extent))
    half = np.float32(extent)
    for k in range(points.shape[0]):
        i = math.floor((points[k, 0] + half) * scale)
        j = math.floor((points[k, 1] + half) * scale)
        if 0 <= i < cells and 0 <= j < cells and points[k, 2] < out[i, j]:
            out[i, j] = points[k, 2]


@njit(cache=True, nogil=True)
def above_floor(points, extent, cells, floor, clearance, keep):
    """Set ``keep`` (n,) where a point stands more than ``clearance`` above its cell's floor."""
    scale = np.float32(cells / (2.0 * extent))
    half = np.float32(extent)
    for k in range(points.shape[0]):
        i = math.floor((points[k, 0] + half) * scale)
        j = math.floor((points[k, 1] + half) * scale)
        inside = 0 <= i < cells and 0 <= j < cells
        keep[k] = inside and points[k, 2] > floor[i, j] + clearance


@njit(cache=True, nogil=True)
def radon_half_turn(images, cosines, sines, bins, scale, out):
    """Pixel-driven Radon transform of (b, h, h) float32 into ``out`` (b, angles, bins).

    Coordinates are in cells from the image's centre; ``scale`` is τ bins a cell. Each occupied
    cell is projected to its τ and shared linearly between the two nearest bins.
    """
    size = images.shape[1]
    centre = np.float32((size - 1) / 2.0)
    middle = np.float32((bins - 1) / 2.0)
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
            row = out[b, a]
            c, s = cosines[a], sines[a]
            for k in range(count):
                position = xs[k] * c + ys[k] * s + middle
                lower = math.floor(position)
                upper_share = position - np.float32(lower)
                if 0 <= lower < bins:
                    row[lower] += values[k] * (np.float32(1.0) - upper_share)
                if -1 <= lower < bins - 1:
                    row[lower + 1] += values[k] * upper_share


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

"""Compiled CPU loops over range images with their points (numba). Imported on first use."""

import math
from typing import no_type_check

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
@no_type_check
def cell_of(x, y, z, low, high, sectors, rows):
    """Sector and row of a point as the sensor sees it; row -1 where it is above or below."""
    azimuth = math.atan2(y, x) / (2.0 * math.pi)
    # Just below 0 it may round to a whole turn.
    sector = math.floor((azimuth - math.floor(azimuth)) * sectors) % sectors
    place = (math.atan2(z, math.sqrt(x * x + y * y)) - low) / (high - low) * rows
    return sector, math.floor(place) if 0 <= place < rows else -1


@njit(cache=True, nogil=True)
@no_type_check
def nearest_points(flat, viewpoint, low, high, reach, ranges, points):
    """The nearest point in each direction, of ``flat`` (3 n,) float32: x, y, z above the ground.

    ``ranges`` (sectors, rows) float32 holds 0 at first and where there is none; ``points``
    (sectors, rows, 3) float64 are as the sensor sees them, ``viewpoint`` metres above the ground.
    Of points equally near the first counts; at 0 and from ``reach`` metres on none does.
    """
    sectors, rows = ranges.shape
    for k in range(flat.shape[0] // 3):
        x, y = np.float64(flat[3 * k]), np.float64(flat[3 * k + 1])
        z = np.float64(flat[3 * k + 2]) - viewpoint
        away = math.sqrt(x * x + y * y + z * z)
        if not 0 < away < reach:
            continue
        sector, row = cell_of(x, y, z, low, high, sectors, rows)
        if row >= 0 and (ranges[sector, row] == 0 or away < ranges[sector, row]):
            ranges[sector, row] = away
            points[sector, row, 0], points[sector, row, 1], points[sector, row, 2] = x, y, z


@njit(cache=True, nogil=True)
@no_type_check
def normals(ranges, points, radial, out):
    """Set ``out`` (3, sectors, rows) to the unit normals that look at the sensor.

    A normal needs the point of its cell, of the next one clockwise, and of the one below. With
    ``radial`` it is outward, to the left and up as seen in the middle of its sector.
    """
    sectors, rows = ranges.shape
    for s in range(sectors):
        right = (s - 1) % sectors
        turn = 2.0 * math.pi * (s + 0.5) / sectors if radial else 0.0
        c, d = math.cos(turn), math.sin(turn)
        for r in range(1, rows):
            if ranges[s, r] == 0 or ranges[right, r] == 0 or ranges[s, r - 1] == 0:
                continue
            a, b = points[s, r - 1] - points[s, r], points[right, r] - points[s, r]
            x, y = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]
            z = a[0] * b[1] - a[1] * b[0]
            size = math.sqrt(x * x + y * y + z * z)
            if size > 0:
                out[0, s, r], out[1, s, r] = (c * x + d * y) / size, (c * y - d * x) / size
                out[2, s, r] = z / size


@njit(cache=True, nogil=True)
@no_type_check
def is_near(seen, s, r, away, tolerance, around):
    """Whether a range in up to ``around`` cells either way of a cell is within the tolerance."""
    sectors, rows = seen.shape
    for i in range(s - around, s + around + 1):
        for j in range(max(0, r - around), min(rows, r + around + 1)):
            there = seen[i % sectors, j]
            if there > 0 and abs(there - away) < tolerance:
                return True
    return False


@njit(cache=True, nogil=True)
@no_type_check
def overlaps(images, pairs, poses, low, high, reach, tolerance, around, out):
    """Set ``out`` (p,) to the overlaps of ``pairs`` (p, 2) of the ranges ``images`` (n, s, r).

    ``poses`` (p, 4, 4) carry the second's points onto the first's.
    """
    sectors, rows = images.shape[1], images.shape[2]
    seen = np.empty((sectors, rows), np.float32)
    for p in range(pairs.shape[0]):
        first, second, pose = images[pairs[p, 0]], images[pairs[p, 1]], poses[p]
        seen[:] = 0
        for s in range(sectors):
            azimuth = 2.0 * math.pi * (s + 0.5) / sectors
            c, d = math.cos(azimuth), math.sin(azimuth)
            for r in range(rows):
                away = np.float64(second[s, r])
                if away <= 0:
                    continue
                elevation = low + (r + 0.5) * (high - low) / rows
                across, up = away * math.cos(elevation), away * math.sin(elevation)
                ahead, aside = across * c, across * d
                x = pose[0, 0] * ahead + pose[0, 1] * aside + pose[0, 2] * up + pose[0, 3]
                y = pose[1, 0] * ahead + pose[1, 1] * aside + pose[1, 2] * up + pose[1, 3]
                z = pose[2, 0] * ahead + pose[2, 1] * aside + pose[2, 2] * up + pose[2, 3]
                now = math.sqrt(x * x + y * y + z * z)
                if not 0 < now < reach:
                    continue
                sector, row = cell_of(x, y, z, low, high, sectors, rows)
                if row >= 0 and (seen[sector, row] == 0 or now < seen[sector, row]):
                    seen[sector, row] = now
        valid, alike = 0, 0
        for s in range(sectors):
            for r in range(rows):
                if first[s, r] > 0:
                    valid += 1
                    alike += int(is_near(seen, s, r, first[s, r], tolerance, around))
        out[p] = alike / valid if valid else 0.0

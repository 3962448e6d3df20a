"""Compiled loops of virtual scans (numba). Imported on first use."""

import math
from typing import no_type_check

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
@no_type_check
def bins_of(points, shift, reach, low, step, depth, cells, ranges):
    """Bin and range of each point (n, 3), metres from where ``shift`` (3,) is the sensor.

    ``depth`` (rows, columns) has elevations from ``low`` in steps of ``step`` (2,), radians, along
    rows and azimuths from -π along columns. ``cells`` (n,) gets the flat bin, -1 beyond ``reach``
    and outside of the rows; ``ranges`` (n,) metres.
    """
    rows, columns = depth.shape
    for k in range(points.shape[0]):
        x = points[k, 0] - shift[0]
        y = points[k, 1] - shift[1]
        z = points[k, 2] - shift[2]
        flat = x * x + y * y
        cells[k] = -1
        if flat > reach * reach or flat == 0.0:
            continue
        row = math.floor((math.atan2(z, math.sqrt(flat)) - low) / step[0])
        if row < 0 or row >= rows:
            continue
        column = math.floor((math.atan2(y, x) + math.pi) / step[1])
        cells[k] = row * columns + min(column, columns - 1)
        ranges[k] = math.sqrt(flat + z * z)


@njit(cache=True, nogil=True)
@no_type_check
def lower_depth(cells, ranges, size, most, step, low, depth):
    """Lower ``depth`` to the range of each point, in all bins that a point of ``size`` covers.

    A point at a range covers the bins whose middle is within size / 2 of the middle of its own, at
    most ``most`` along each axis.
    """
    rows, columns = depth.shape
    for k in range(cells.shape[0]):
        if cells[k] < 0:
            continue
        row, column = cells[k] // columns, cells[k] % columns
        distance = ranges[k]
        half = 0.5 * size / distance
        up = min(int(half / step[0]), most // 2)
        # Bins of one azimuth are narrower where one looks up or down.
        narrow = max(math.cos(low + (row + 0.5) * step[0]), 0.1)
        aside = min(int(half / (step[1] * narrow)), most // 2)
        for i in range(max(row - up, 0), min(row + up, rows - 1) + 1):
            for j in range(column - aside, column + aside + 1):
                at = j % columns
                if distance < depth[i, at]:
                    depth[i, at] = distance


@njit(cache=True, nogil=True)
@no_type_check
def seen(points, shift, cells, ranges, depth, behind, out, count):
    """Append to ``out``, after its first ``count``, the points at most ``behind`` their depth.

    They are metres from the sensor. Returns the new count.
    """
    columns = depth.shape[1]
    for k in range(points.shape[0]):
        cell = cells[k]
        if cell >= 0 and ranges[k] <= depth[cell // columns, cell % columns] + behind:
            for axis in range(3):
                out[count, axis] = np.float32(points[k, axis] - shift[axis])
            count += 1
    return count

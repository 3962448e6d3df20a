"""Compiled CPU loops of Semantic Scan Context (numba). Imported on first use.

numba's cache does not notice changes in `deepring.rasters._polar_kernels`: delete ``__pycache__``
after an edit.
"""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from deepring.rasters._lots import LOT
from deepring.rasters._polar_kernels import polar_cells

#: Limits of the offset's search, as published: steps, metres between the points of a pair along
#: each axis, metres of a last step, metres of the whole offset along each axis.
STEPS, PAIR, LAST_STEP, LONGEST = 100, 3.0, 1e-5, 5.0


@njit(cache=True, nogil=True)
@no_type_check
def millimetres(marks):
    """Range of each landmark (sectors,) in whole millimetres, so that sums are exact; 0: none."""
    ranges = np.zeros(marks.shape[0], np.int32)
    for k in range(marks.shape[0]):
        if marks[k, 2] > 0:
            x, y = np.float64(marks[k, 0]), np.float64(marks[k, 1])
            ranges[k] = np.int32(np.rint(1000.0 * math.sqrt(x * x + y * y)))
    return ranges


@njit(cache=True, nogil=True)
@no_type_check
def best_roll(query, entry):
    """The first roll of the entry's ranges (sectors,) whose L1 distance to the query's is least."""
    count = query.shape[0]
    twice = np.empty(2 * count, np.int32)
    twice[:count], twice[count:] = entry, entry
    best, least = 0, np.iinfo(np.int64).max
    for roll in range(count):
        rolled = twice[count - roll :]
        total = 0
        for k in range(count):
            total += abs(query[k] - rolled[k])
        if total < least:
            best, least = roll, total
    return best


@njit(cache=True, nogil=True)
@no_type_check
def turned_marks(marks, roll, half):
    """Landmarks turned by ``roll`` sectors and put in their new sectors, ``half`` more each way."""
    sectors = marks.shape[0]
    turn = 2.0 * math.pi * roll / sectors
    c, s = math.cos(turn), math.sin(turn)
    out = np.empty((sectors + 2 * half, 3))
    for k in range(out.shape[0]):
        mark = marks[(k - half - roll) % sectors]
        out[k, 0] = c * mark[0] - s * mark[1]
        out[k, 1] = s * mark[0] + c * mark[1]
        out[k, 2] = mark[2]
    return out


@njit(cache=True, nogil=True)
@no_type_check
def mean_step(query, marks, match_labels, half, x, y):
    """Mean way (x, y) from the entry's landmarks, moved by x and y, to the query's, and the pairs.

    Each landmark of the query is paired with the nearest of the sectors around.
    """
    sum_x, sum_y, pairs = 0.0, 0.0, 0
    for k in range(query.shape[0]):
        if query[k, 2] <= 0:
            continue
        nearest, step_x, step_y = np.inf, 0.0, 0.0
        for j in range(k, k + 2 * half + 1):
            mark = marks[j, 2]
            if mark <= 0 or (match_labels and mark != query[k, 2]):
                continue
            dx, dy = query[k, 0] - marks[j, 0] - x, query[k, 1] - marks[j, 1] - y
            if dx * dx + dy * dy < nearest:
                nearest, step_x, step_y = dx * dx + dy * dy, dx, dy
        if nearest < np.inf and abs(step_x) < PAIR and abs(step_y) < PAIR:
            sum_x, sum_y, pairs = sum_x + step_x, sum_y + step_y, pairs + 1
    return sum_x / max(pairs, 1), sum_y / max(pairs, 1), pairs


@njit(cache=True, nogil=True)
@no_type_check
def best_offset(query, entry, roll, match_labels, half):
    """The way (x, y) by which the turned entry's landmarks fit the query's; 0 where it is far."""
    marks = turned_marks(entry, roll, half)
    x, y = 0.0, 0.0
    for _ in range(STEPS):
        step_x, step_y, pairs = mean_step(query, marks, match_labels, half, x, y)
        x, y = x + step_x, y + step_y
        if pairs == 0 or (abs(step_x) < LAST_STEP and abs(step_y) < LAST_STEP):
            break
    if abs(x) > LONGEST or abs(y) > LONGEST:
        return 0.0, 0.0
    return x, y


@njit(cache=True, nogil=True)
@no_type_check
def draw(points, priority, turn, x, y, radius, out):
    """Raise ``out`` (sectors, rings) uint8 to the priorities of turned and moved points (n, 3)."""
    sectors, rings = out.shape
    c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
    dx, dy = np.float32(x), np.float32(y)
    xs, ys = np.empty(LOT, np.float32), np.empty(LOT, np.float32)
    for start in range(0, points.shape[0], LOT):
        count = 0
        for k in range(start, min(start + LOT, points.shape[0])):
            if points[k, 2] <= 0:  # no points follow
                break
            xs[count] = c * points[k, 0] - s * points[k, 1] + dx
            ys[count] = s * points[k, 0] + c * points[k, 1] + dy
            count += 1
        sector, ring = polar_cells(xs[:count], ys[:count], radius, sectors, rings)
        for k in range(count):
            if ring[k] < rings:
                rank = priority[int(points[start + k, 2])]
                if rank > out[sector[k], ring[k]]:
                    out[sector[k], ring[k]] = rank
        if count < LOT:
            break


@njit(cache=True, nogil=True)
@no_type_check
def share_alike(query, entry):
    """Cells of one class in both of those filled in either, of two images; 0 where none is."""
    alike, filled = 0, 0
    a, b = query.reshape(-1), entry.reshape(-1)
    for k in range(a.shape[0]):
        alike += int((a[k] == b[k]) & (a[k] > 0))
        filled += int((a[k] | b[k]) > 0)
    return alike / filled if filled else 0.0


@njit(cache=True, nogil=True)
@no_type_check
def align_all(query, entries, which, priority, shape, radius, match_labels, half, out):
    """Align one query (sectors + n, 3) with the entries of numbers ``which`` (m,).

    ``out`` (m, 4) float64 becomes score, roll in sectors, and x and y in metres.
    """
    sectors = shape[0]
    image, moved = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    draw(query[sectors:], priority, 0.0, 0.0, 0.0, radius, image)
    marks, ranges = query[:sectors].astype(np.float64), millimetres(query[:sectors])
    for m in range(which.shape[0]):
        entry = entries[which[m]]
        roll = best_roll(ranges, millimetres(entry[:sectors]))
        x, y = best_offset(marks, entry[:sectors].astype(np.float64), roll, match_labels, half)
        moved[:] = 0
        turn = 2.0 * math.pi * roll / sectors
        draw(entry[sectors:], priority, turn, x, y, radius, moved)
        out[m, 0], out[m, 1], out[m, 2], out[m, 3] = share_alike(image, moved), roll, x, y

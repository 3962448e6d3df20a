"""Compiled CPU loops of the alignment (numba). Imported on first use."""

import math
from typing import no_type_check

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
@no_type_check
def draw(cells, cosines, sines, extent, cell, out):
    """Add the cells (m, 2), metres, turned back by each of t turns, to images ``out`` (t, n, n).

    A cell is shared among the four that it falls between; what falls beyond is dropped."""
    scale = np.float32(1.0 / cell)
    offset = np.float32(extent / cell - 0.5)
    for k in range(cosines.shape[0]):
        c, s, image = cosines[k] * scale, sines[k] * scale, out[k]
        for m in range(cells.shape[0]):
            x = c * cells[m, 0] + s * cells[m, 1] + offset
            y = c * cells[m, 1] - s * cells[m, 0] + offset
            share(image, x, y)


@njit(cache=True, nogil=True)
@no_type_check
def draw_smaller(images, out):
    """Add the cells of images (k, n, n) uint8 to images ``out`` (k, c, c) of cells of twice the
    side, around the same middle."""
    n, count = images.shape[1], out.shape[1]
    half = np.float32(0.5)
    offset = half * np.float32(count - half * n - half)
    for k in range(images.shape[0]):
        image = out[k]
        for i in range(n):
            for j in range(n):
                if images[k, i, j]:
                    share(image, half * np.float32(i) + offset, half * np.float32(j) + offset)


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def share(image, x, y):
    """Share one at (x, y), in cells from the middle of the first, among the four around it."""
    i, j, count = math.floor(x), math.floor(y), image.shape[0]
    u, v = x - np.float32(i), y - np.float32(j)
    one = np.float32(1)
    if 0 <= i < count - 1 and 0 <= j < count - 1:
        image[i, j] += (one - u) * (one - v)
        image[i, j + 1] += (one - u) * v
        image[i + 1, j] += u * (one - v)
        image[i + 1, j + 1] += u * v
        return
    for di in range(2):
        for dj in range(2):
            if 0 <= i + di < count and 0 <= j + dj < count:
                image[i + di, j + dj] += (u if di else one - u) * (v if dj else one - v)


@njit(cache=True, nogil=True, fastmath=True)
@no_type_check
def half_whiten(spectra, transfer, times):
    """Multiply spectra (n, f) complex64 by ``transfer`` (f,), divide them by the root of their
    sizes, and scale them to unit norm; ``times`` (f,) is how often each frequency counts."""
    least = np.float32(1e-24)
    roots = np.empty(spectra.shape[1], np.float32)
    for k in range(spectra.shape[0]):
        one, power = spectra[k], np.float32(0)
        for f in range(one.shape[0]):
            re, im = one[f].real * transfer[f], one[f].imag * transfer[f]
            size = np.sqrt(re * re + im * im)
            power += size * times[f]
            roots[f] = np.sqrt(size + least)
        norm = np.float32(1) / np.sqrt(power + least)
        for f in range(one.shape[0]):
            one[f] *= transfer[f] * norm / roots[f]


@njit(cache=True, nogil=True)
@no_type_check
def multiply(behind, places, queries, pairs, out):
    """Write place times conjugate query into ``out`` (p, f).

    pairs (p, 3) are their numbers, and whether the query is turned by half a turn more: its
    spectrum times ``behind`` (f,) is then the conjugate one."""
    for k in range(pairs.shape[0]):
        place, query, product = places[pairs[k, 0]], queries[pairs[k, 1]], out[k]
        if pairs[k, 2]:
            for f in range(place.shape[0]):
                product[f] = place[f] * (query[f] * behind[f])
        else:
            for f in range(place.shape[0]):
                product[f] = place[f] * np.conj(query[f])


@njit(cache=True, nogil=True)
@no_type_check
def peaks(curves, reach, height, shift):
    """The largest values of curves (n, side, side) over shifts up to ``reach`` along both axes.

    Writes their ``height`` (n,) and ``shift`` (n, 2) in cells, refined by a parabola along each
    axis. Negative shifts are at the ends of the axes."""
    for k in range(curves.shape[0]):
        curve = curves[k]
        best, row = curve[-reach, 0], -reach
        for i in range(-reach, reach + 1):
            top = largest(curve[i], reach)
            if top > best:
                best, row = top, i
        column = -reach
        while curve[row, column] != best and column < reach:
            column += 1
        height[k] = best
        i = min(max(row, 1 - reach), reach - 1)
        j = min(max(column, 1 - reach), reach - 1)
        shift[k, 0] = i + vertex(curve[i - 1, j], curve[i, j], curve[i + 1, j])
        shift[k, 1] = j + vertex(curve[i, j - 1], curve[i, j], curve[i, j + 1])


@njit(cache=True, nogil=True, fastmath=True)
@no_type_check
def largest(line, reach):
    """The largest value of a line over shifts up to ``reach``; a loop of vector instructions."""
    top = line[0]
    for j in range(1, reach + 1):
        top = max(top, line[j])
    for j in range(line.shape[0] - reach, line.shape[0]):
        top = max(top, line[j])
    return top


@njit(cache=True, nogil=True)
@no_type_check
def vertex(before, middle, after):
    """Peak of the parabola through three values, in steps from the middle, in [-1, 1]."""
    bend = max(2 * middle - before - after, np.float32(1e-12))
    return min(max((after - before) / (2 * bend), -1.0), 1.0)

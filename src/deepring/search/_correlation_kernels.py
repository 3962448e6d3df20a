"""Compiled CPU loops of the search (numba). Imported on first use."""

import math
from typing import no_type_check

import numpy as np
from numba import njit, types
from numba.extending import overload

#: Codes whose sums are computed at once, within the processor's first cache.
LOT = 512

#: Width of the rows of the package's network. Vector instructions take 64 numbers at a time, and
#: narrower rows one by one, unless the compiler knows the width: that is three times as fast.
NARROW = 32


def _read(number):
    """A stored number as float32; uint16 is bfloat16, the upper half of a float32."""


@overload(_read)
@no_type_check
def _read_typed(number):
    if number == types.uint16:
        return lambda number: np.uint32(np.uint32(number) << np.uint32(16)).view(np.float32)
    return lambda number: np.float32(number)  # noqa: PLW0108 - numba types a lambda alone


@njit(cache=True, nogil=True, fastmath=True)
@no_type_check
def cross_spectrum(query, place, scale, real, imaginary):
    """Write Σ_ω Q(k, ω) conj D(k, ω) times ``scale`` (k,) into ``real`` and ``imaginary`` (k,).

    The query (k, 2, w) is float32, the place (k, 2, w) of any precision."""
    if place.shape[2] == NARROW:
        sums(query, place, scale, real, imaginary, NARROW)
    else:
        sums(query, place, scale, real, imaginary, place.shape[2])


@njit(cache=True, nogil=True, fastmath=True, inline="always")
@no_type_check
def sums(query, place, scale, real, imaginary, width):
    """`cross_spectrum` of rows of a width that the compiler may know."""
    for k in range(place.shape[0]):
        re, im = np.float32(0), np.float32(0)
        for w in range(width):
            x, y = _read(place[k, 0, w]), _read(place[k, 1, w])
            re += query[k, 0, w] * x + query[k, 1, w] * y
            im += query[k, 1, w] * x - query[k, 0, w] * y
        real[k] = re * scale[k]
        imaginary[k] = im * scale[k]


@njit(cache=True, nogil=True, fastmath=True)
@no_type_check
def search(
    queries, query_tails, places, scales, tails, which, first, basis, step, score, place, shift
):
    """Search the places numbered ``which`` and keep the best of each query.

    The largest value of a curve is at most the sum of the magnitudes of its frequencies. After
    each ``step`` frequencies, the rest add at most the product of the tail norms of query and
    place: a place that cannot beat the last of the best is skipped.

    queries (q, k, 2, w) float32 and their tail norms (q, c), places (n, k, 2, w), scales (n, k)
    and tail norms (n, c); ``first`` is added to the places' numbers; basis (2, k, θ) is the
    weighted cosines and sines of the inverse transform. The best so far, best first: score (q,
    best) float32, place and shift (q, best) int64.
    """
    frequencies, rows = basis.shape[1], basis.shape[2]
    real, imaginary = np.empty(frequencies, np.float32), np.empty(frequencies, np.float32)
    curve = np.empty(rows, np.float32)
    last = score.shape[1] - 1
    # Each place is read from memory once and compared with all queries, which stay in the cache.
    for i in range(which.shape[0]):
        one, scale, tail = places[which[i]], scales[which[i]], tails[which[i]]
        for b in range(queries.shape[0]):
            bound, reach = np.float32(0), np.float32(0)
            for start in range(0, frequencies, step):
                end = min(start + step, frequencies)
                re, im = real[start:end], imaginary[start:end]
                cross_spectrum(queries[b, start:end], one[start:end], scale[start:end], re, im)
                for k in range(end - start):
                    size = math.sqrt(re[k] * re[k] + im[k] * im[k])
                    bound += basis[0, start + k, 0] * size
                reach = bound
                if end < frequencies:
                    reach += query_tails[b, start // step] * tail[start // step]
                # Numbers are rounded; the factor keeps the bound valid.
                if reach * np.float32(1.00001) <= score[b, last]:
                    break
            if reach * np.float32(1.00001) <= score[b, last]:
                continue
            curve[:] = 0
            for k in range(frequencies):
                for t in range(rows):
                    curve[t] += real[k] * basis[0, k, t] - imaginary[k] * basis[1, k, t]
            best = np.argmax(curve)
            if curve[best] > score[b, last]:
                insert(score[b], place[b], shift[b], curve[best], first + which[i], best)


@njit(cache=True, nogil=True)
@no_type_check
def insert(score, place, shift, value, number, turn):
    """Insert a value in order among the best, after equal ones, and drop the last."""
    k = score.shape[0] - 1
    while k > 0 and value > score[k - 1]:
        score[k], place[k], shift[k] = score[k - 1], place[k - 1], shift[k - 1]
        k -= 1
    score[k], place[k], shift[k] = value, number, turn


@njit(cache=True, nogil=True, fastmath=True)
@no_type_check
def code_scores(queries, codes, out):
    """Write Σ_k |Σ_p Q(k, p) conj D(k, p)| into ``out`` (q, n) float32.

    Queries are (q, k, p, 2) float32; the first n of the codes (k, p, 2, N) int8 count."""
    real, imaginary = np.empty(LOT, np.float32), np.empty(LOT, np.float32)
    for start in range(0, out.shape[1], LOT):
        lot = min(LOT, out.shape[1] - start)
        for b in range(queries.shape[0]):
            total = out[b, start : start + lot]
            total[:] = 0
            for k in range(codes.shape[0]):
                real[:lot] = 0
                imaginary[:lot] = 0
                for p in range(codes.shape[1]):
                    u, v = queries[b, k, p, 0], queries[b, k, p, 1]
                    part = codes[k, p, :, start : start + lot]
                    for i in range(lot):
                        x, y = np.float32(part[0, i]), np.float32(part[1, i])
                        real[i] += u * x + v * y
                        imaginary[i] += v * x - u * y
                for i in range(lot):
                    total[i] += math.sqrt(real[i] * real[i] + imaginary[i] * imaginary[i])

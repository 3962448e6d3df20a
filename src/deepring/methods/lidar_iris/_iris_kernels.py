"""Compiled CPU loops over the bits of LiDAR-Iris (numba). Imported on first use."""

from typing import no_type_check

import numpy as np
from numba import njit

_ONES, _PAIRS = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333)
_NIBBLES, _BYTES = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x0101010101010101)
_1, _2, _4, _56 = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


@njit(cache=True, nogil=True, inline="always")
@no_type_check
def _set_bits(word):
    """Number of bits that are set. The compiler knows these lines and takes an instruction."""
    word = word - ((word >> _1) & _ONES)
    word = (word & _PAIRS) + ((word >> _2) & _PAIRS)
    word = (word + (word >> _4)) & _NIBBLES
    return (word * _BYTES) >> _56


@njit(cache=True, nogil=True)
@no_type_check
def _pair(real, imaginary, counts, other_real, other_imaginary, other_counts):
    """Bits that differ, and bits that count, of parts (words,) of two codes."""
    differ, valid = np.uint64(0), np.uint64(0)
    for k in range(real.shape[0]):
        both = counts[k] & other_counts[k]
        valid += _set_bits(both)
        differ += _set_bits((real[k] ^ other_real[k]) & both)
        differ += _set_bits((imaginary[k] ^ other_imaginary[k]) & both)
    return differ, valid + valid


@njit(cache=True, nogil=True)
@no_type_check
def _twice(part):
    """The words (θ, words) of all sectors, and again, (2 θ words,)."""
    flat = part.reshape(part.size)
    return np.concatenate((flat, flat))


@njit(cache=True, nogil=True)
@no_type_check
def nearest_shifts(query, entries, distance, shift):
    """Write the least share of bits that differ, over all shifts, and the first shift with it.

    ``query`` is (3, θ, words) and ``entries`` (n, 3, θ, words) uint64; the parts are those of
    `IrisCode`. The query is the entry rolled by +shift. Without bits that count, 1."""
    _, sectors, words = query.shape
    size = sectors * words
    # Arrays of one axis, which the compiler knows to be contiguous, allow vector instructions.
    real, imaginary, counts = _twice(query[0]), _twice(query[1]), _twice(query[2])
    for n in range(entries.shape[0]):
        other_real, other_imaginary = entries[n, 0].reshape(size), entries[n, 1].reshape(size)
        other_counts = entries[n, 2].reshape(size)
        distance[n], shift[n] = 1.0, 0
        for s in range(sectors):
            start, end = s * words, s * words + size
            differ, valid = _pair(
                real[start:end],
                imaginary[start:end],
                counts[start:end],
                other_real,
                other_imaginary,
                other_counts,
            )
            if valid > 0 and differ / valid < distance[n]:
                distance[n], shift[n] = differ / valid, s

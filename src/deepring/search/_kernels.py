"""Compiled CPU loops of the search (numba). Imported on first use."""

import math

import numpy as np
from numba import njit

# A place is read once from memory and compared with all queries, which stay in the cache.


@njit(cache=True, nogil=True, fastmath=True)
def cross_spectra(queries, places, out):
    """Σ_ω Q(k, ω) conj D(k, ω) of queries (q, k, 2, w) float32 with places (n, k, 2, w), real
    and imaginary parts apart, float32 or int8: ``out`` (q, n, k, 2) float32."""
    frequencies, width = places.shape[1], places.shape[3]
    for i in range(places.shape[0]):
        for b in range(queries.shape[0]):
            for k in range(frequencies):
                real, imaginary = np.float32(0), np.float32(0)
                for w in range(width):
                    x, y = np.float32(places[i, k, 0, w]), np.float32(places[i, k, 1, w])
                    real += queries[b, k, 0, w] * x + queries[b, k, 1, w] * y
                    imaginary += queries[b, k, 1, w] * x - queries[b, k, 0, w] * y
                out[b, i, k, 0] = real
                out[b, i, k, 1] = imaginary


@njit(cache=True, nogil=True, fastmath=True)
def cross_spectra_bfloat16(queries, places, out):
    """The same for places whose bits are the upper halves of float32: (n, k, 2, w) uint16."""
    frequencies, width = places.shape[1], places.shape[3]
    shift = np.uint32(16)
    for i in range(places.shape[0]):
        for b in range(queries.shape[0]):
            for k in range(frequencies):
                real, imaginary = np.float32(0), np.float32(0)
                for w in range(width):
                    x = np.uint32(np.uint32(places[i, k, 0, w]) << shift).view(np.float32)
                    y = np.uint32(np.uint32(places[i, k, 1, w]) << shift).view(np.float32)
                    real += queries[b, k, 0, w] * x + queries[b, k, 1, w] * y
                    imaginary += queries[b, k, 1, w] * x - queries[b, k, 0, w] * y
                out[b, i, k, 0] = real
                out[b, i, k, 1] = imaginary


@njit(cache=True, nogil=True, fastmath=True)
def code_scores(queries, codes, out):
    """Σ_k |Σ_p Q(p, k) conj D(p, k)| of queries (q, p, 2, k) float32 with codes (n, p, 2, k)
    int8: ``out`` (q, n) float32."""
    components, frequencies = codes.shape[1], codes.shape[3]
    real = np.empty(frequencies, np.float32)
    imaginary = np.empty(frequencies, np.float32)
    for i in range(codes.shape[0]):
        for b in range(queries.shape[0]):
            real[:] = 0
            imaginary[:] = 0
            for p in range(components):
                for k in range(frequencies):
                    x, y = np.float32(codes[i, p, 0, k]), np.float32(codes[i, p, 1, k])
                    real[k] += queries[b, p, 0, k] * x + queries[b, p, 1, k] * y
                    imaginary[k] += queries[b, p, 1, k] * x - queries[b, p, 0, k] * y
            total = np.float32(0)
            for k in range(frequencies):
                total += math.sqrt(real[k] * real[k] + imaginary[k] * imaginary[k])
            out[b, i] = total

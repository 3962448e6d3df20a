"""The Radon transform as a compiled loop (numba). Imported on first use."""

from typing import no_type_check

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
@no_type_check  # numba compiles what is written here, not a wrapper that checks arguments
def radon(images, cosines, sines, scale, unit, out):
    """Pixel-driven Radon transform of (b, h, h) uint8 or float32 into ``out`` (b, angles, bins).

    Coordinates are in cells from the image's centre; ``scale`` is τ bins per cell, ``unit`` the
    side of a cell. Each occupied cell is projected to its τ and shared linearly between the two
    nearest bins. Further angles repeat those half a turn earlier, flipped in τ.
    """
    size, bins = images.shape[1], out.shape[2]
    half, mirrored = cosines.shape[0], out.shape[1] > cosines.shape[0]
    centre = np.float32((size - 1) / 2.0)
    xs = np.empty(size * size, np.float32)
    ys = np.empty(size * size, np.float32)
    values = np.empty(size * size, np.float32)
    lower = np.empty(size * size, np.uint32)
    share = np.empty(size * size, np.float32)
    # Contributions to a bin and to the bin above it, side by side, so that each cell writes to one
    # place in memory. A spare bin on either side takes contributions beyond the ends.
    pairs = np.empty((bins + 2, 2), np.float32)
    for b in range(images.shape[0]):
        count = 0
        for i in range(size):
            for j in range(size):
                # Few cells are occupied, so that the branch is predicted well.
                if images[b, i, j] != 0:
                    xs[count] = (i - centre) * scale
                    ys[count] = (j - centre) * scale
                    values[count] = images[b, i, j] * scale
                    count += 1
        for a in range(cosines.shape[0]):
            project(xs[:count], ys[:count], cosines[a], sines[a], bins, lower, share)
            pairs[:] = 0.0
            for k in range(count):
                upper = values[k] * share[k]
                pairs[lower[k], 0] += values[k] - upper
                pairs[lower[k], 1] += upper
            for m in range(bins):
                out[b, a, m] = (pairs[m + 1, 0] + pairs[m, 1]) * unit
            if mirrored:
                out[b, half + a] = out[b, a, ::-1]


@njit(cache=True, nogil=True)
@no_type_check  # numba compiles what is written here, not a wrapper that checks arguments
def project(xs, ys, cosine, sine, bins, lower, share):
    """The bin below each cell's τ, with a spare bin at 0, and the share of the bin above it.

    Cells beyond the ends contribute to no real bin."""
    middle, last = np.float32((bins + 1) / 2.0), np.float32(bins + 1)
    for k in range(xs.shape[0]):
        position = xs[k] * cosine + ys[k] * sine + middle
        inside = (position >= 0) & (position < last)
        position = position if inside else np.float32(0)
        whole = np.int32(position)
        lower[k] = np.uint32(whole)
        share[k] = position - np.float32(whole)

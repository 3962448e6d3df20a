"""Compiled CPU loops over the planes of M2DP (numba). Imported on first use."""

import math
from typing import no_type_check

import numpy as np
from numba import njit

from deepring.rasters._polar_kernels import rough_angle

#: Bound on the error of `rough_angle`, radians, with that of its float32 arguments.
_OFF = 4e-6

#: Points at once: their angles and radii fit into the processor's first cache.
_LOT = 1024


@njit(cache=True, nogil=True)
@no_type_check
def plane_counts(points, along, across, farthest, angular, out):
    """Add the points (n, 3) to the bins of each plane in ``out`` (planes, radial, angular) int64.

    ``along`` and ``across`` (planes, 3) are the planes' axes, ``farthest`` the largest distance of
    a point from the origin. The edges of radii are squares of equal steps; the last bins of both
    kinds are closed. Sectors follow a polynomial's angle, and the exact one close to a border."""
    planes, radial = out.shape[0], out.shape[1]
    width = np.float32(angular / (2.0 * math.pi))
    margin = np.float32(_OFF * angular + 1e-6 * angular)
    ring_scale = radial / math.sqrt(farthest)
    xs, ys = np.empty(_LOT, np.float64), np.empty(_LOT, np.float64)
    place, ring = np.empty(_LOT, np.float32), np.empty(_LOT, np.int64)
    for start in range(0, points.shape[0], _LOT):
        lot = points[start : start + _LOT]
        size = lot.shape[0]
        for plane in range(planes):
            ax, ay, az = along[plane, 0], along[plane, 1], along[plane, 2]
            bx, by, bz = across[plane, 0], across[plane, 1], across[plane, 2]
            for k in range(size):
                xs[k] = ax * lot[k, 0] + ay * lot[k, 1] + az * lot[k, 2]
                ys[k] = bx * lot[k, 0] + by * lot[k, 1] + bz * lot[k, 2]
                root = math.sqrt(math.sqrt(xs[k] * xs[k] + ys[k] * ys[k]))
                ring[k] = np.int64(root * ring_scale)
            for k in range(size):
                angle = rough_angle(np.float32(ys[k]), np.float32(xs[k]))
                place[k] = (angle + np.float32(math.pi)) * width
            for k in range(size):
                sector = np.int64(place[k])
                over = place[k] - np.float32(sector)
                if not (margin < over < 1 - margin):
                    turn = (math.atan2(ys[k], xs[k]) + math.pi) / (2.0 * math.pi)
                    sector = np.int64(turn * angular)
                out[plane, min(ring[k], radial - 1), min(max(sector, 0), angular - 1)] += 1

"""Compiled CPU loops over neighbourhoods of several sizes (numba). Imported on first use."""

from typing import no_type_check

import numpy as np
from numba import njit

#: Sweeps of Jacobi's rotations; symmetric 3 x 3 matrices are diagonal after four or five.
_SWEEPS = 12

#: Eigenvalues below this share of the largest are rounding errors, and count as 0.
_ROUNDING = 1e-9


@njit(cache=True, nogil=True)
@no_type_check
def chosen_neighbourhoods(points, near, sizes, moments, axis):
    """Describe the neighbourhood of least entropy of each point, of several sizes.

    A neighbourhood of size k is the first k columns of ``near``. Its entropy is that of the shares
    (λ1 - λ2, λ2 - λ3, λ3) / λ1 of the eigenvalues of its covariance, rounded to 9 digits, so that
    the smallest of equals is taken.

    Args:
        points: (n, 3) float64.
        near: (n, most) int64, numbers of points, nearest first.
        sizes: (m,) int64, increasing, at most ``most``.
        moments: out, (n, 9) float64: λ1 >= λ2 >= λ3, the covariance's xx, xy and yy, the range of
            z, its variance (over k, not k - 1), and k.
        axis: out, (n, 3) float64: the unit eigenvector of λ3, or 0 where all points coincide.
    """
    cov, vectors = np.empty((3, 3)), np.empty((3, 3))
    values, sums = np.empty(3), np.empty(9)
    for i in range(points.shape[0]):
        sums[:] = 0.0
        low, high = np.inf, -np.inf
        least, taken = np.inf, 0
        for size in sizes:
            while taken < size:
                p = near[i, taken]
                taken += 1
                x = points[p, 0] - points[i, 0]
                y = points[p, 1] - points[i, 1]
                z = points[p, 2] - points[i, 2]
                sums[0] += x
                sums[1] += y
                sums[2] += z
                sums[3] += x * x
                sums[4] += x * y
                sums[5] += x * z
                sums[6] += y * y
                sums[7] += y * z
                sums[8] += z * z
                low, high = min(low, z), max(high, z)
            covariance(sums, size, cov)
            xx, xy, yy, zz = cov[0, 0], cov[0, 1], cov[1, 1], cov[2, 2]
            eigen(cov, values, vectors)
            entropy = np.round(dimensionality_entropy(values), 9)
            if entropy < least:
                least = entropy
                moments[i, 0], moments[i, 1], moments[i, 2] = values[0], values[1], values[2]
                moments[i, 3], moments[i, 4], moments[i, 5] = xx, xy, yy
                moments[i, 6], moments[i, 7] = high - low, zz * (size - 1) / size
                moments[i, 8] = size
                axis[i] = vectors[:, 2] if values[0] > 0 else np.zeros(3)


@njit(cache=True, nogil=True)
@no_type_check
def covariance(sums, size, cov):
    """Set ``cov`` (3, 3) to the covariance, over size - 1, of points with these sums.

    ``sums`` are those of x, y, z, xx, xy, xz, yy, yz and zz.
    """
    share = 1.0 / max(size - 1, 1)
    k = 3
    for a in range(3):
        for b in range(a, 3):
            cov[a, b] = cov[b, a] = (sums[k] - sums[a] * sums[b] / size) * share
            k += 1


@njit(cache=True, nogil=True)
@no_type_check
def dimensionality_entropy(values):
    """Entropy of (λ1 - λ2, λ2 - λ3, λ3) / λ1; 0 where all are 0."""
    if values[0] <= 0:
        return 0.0
    entropy = 0.0
    for k in range(3):
        share = (values[k] - (values[k + 1] if k < 2 else 0.0)) / values[0]
        if share > 0:
            entropy -= share * np.log(share)
    return entropy


@njit(cache=True, nogil=True)
@no_type_check
def eigen(matrix, values, vectors):
    """Eigenvalues, falling and not below 0, and eigenvectors in columns, by Jacobi's rotations.

    The symmetric ``matrix`` (3, 3) is overwritten.
    """
    vectors[:] = np.eye(3)
    for _ in range(_SWEEPS):
        off = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off <= 1e-16 * (abs(matrix[0, 0]) + abs(matrix[1, 1]) + abs(matrix[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] != 0:
                    _rotate(matrix, vectors, p, q)
    for k in range(3):
        values[k] = matrix[k, k]
    for a in range(2):  # by falling value
        for b in range(2 - a):
            if values[b] < values[b + 1]:
                values[b], values[b + 1] = values[b + 1], values[b]
                for r in range(3):
                    vectors[r, b], vectors[r, b + 1] = vectors[r, b + 1], vectors[r, b]
    for k in range(3):
        if values[k] <= _ROUNDING * values[0]:
            values[k] = 0.0


@njit(cache=True, nogil=True)
@no_type_check
def _rotate(matrix, vectors, p, q):
    """Turn axes p and q so that their common entry of the symmetric matrix becomes 0."""
    slope = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    tangent = 1.0 / (abs(slope) + np.sqrt(slope * slope + 1.0))
    if slope < 0:
        tangent = -tangent
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    change = tangent * matrix[p, q]
    matrix[p, p] -= change
    matrix[q, q] += change
    matrix[p, q] = matrix[q, p] = 0.0
    r = 3 - p - q
    first, second = matrix[r, p], matrix[r, q]
    matrix[r, p] = matrix[p, r] = cosine * first - sine * second
    matrix[r, q] = matrix[q, r] = sine * first + cosine * second
    for k in range(3):
        first, second = vectors[k, p], vectors[k, q]
        vectors[k, p] = cosine * first - sine * second
        vectors[k, q] = sine * first + cosine * second

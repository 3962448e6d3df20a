"""Reducing a cloud to a fixed number of points. What comes out does not depend on their order."""

import math

import numpy as np
from numpy.typing import NDArray

#: Metres: below it points are taken for the same, above it a voxel holds any scan.
SMALLEST, LARGEST = 1e-3, 1e3

#: The search for a voxel size ends where it leaves at most this many times the points wanted.
SURPLUS = 1.01


def spread(n: int, count: int) -> NDArray[np.int64]:
    """``count`` indices spread evenly over 0 to n - 1, in order, (count,) int64.

    Without repetition where n >= count; else each index comes ⌊count / n⌋ or ⌈count / n⌉ times.

    >>> spread(10, 4)
    array([0, 2, 5, 7])
    """
    return np.arange(count, dtype=np.int64) * n // count


def fixed_count(points: NDArray[np.float32], count: int) -> NDArray[np.float64]:
    """Exactly ``count`` points of (n, 3), metres, spread over what they cover: (count, 3) float64.

    More points are reduced to the means of the voxels of a cubic grid, whose size is searched so
    that just at least ``count`` remain; what is still too many is left out evenly along the grid.
    So far as PointNetVLAD's published code (mikacuy/pointnetvlad, submap_generation), which goes
    to just below the count and fills up at random. Fewer points are repeated evenly; no points
    give zeros. The points are sorted first, so that their order does not matter at all.

    >>> fixed_count(np.array([[1, 2, 3]], dtype=np.float32), 2)
    array([[1., 2., 3.],
           [1., 2., 3.]])
    """
    if not len(points):
        return np.zeros((count, 3))
    points = points[np.lexsort(points.T[::-1])]
    size = voxel_size(points, count) if len(points) > count else None
    chosen = points.astype(np.float64) if size is None else voxel_means(points, size)
    return chosen[spread(len(chosen), count)]


def voxel_size(points: NDArray[np.float32], count: int) -> float | None:
    """A voxel size, metres, that leaves at least ``count`` of the points (n, 3), just so.

    None where not even the smallest voxels leave as many, that is where points coincide. The
    number of voxels falls with their size but for small ups and downs, hence "just so".
    """
    low, high = SMALLEST, LARGEST
    if _occupied(points, low) < count:
        return None
    while high > 1.001 * low:
        middle = math.sqrt(low * high)
        left = _occupied(points, middle)
        if left < count:
            high = middle
            continue
        low = middle
        if left <= SURPLUS * count:
            break
    return low


def voxel_means(points: NDArray[np.float32], size: float) -> NDArray[np.float64]:
    """Mean of the points (n, 3) in each occupied voxel of ``size`` metres: (m, 3) float64.

    The grid starts at the origin; voxels come in the order of x, then y, then z.

    >>> voxel_means(np.array([[0, 0, 0], [1, 1, 1], [9, 9, 9]], dtype=np.float32), size=5.0)
    array([[0.5, 0.5, 0.5],
           [9. , 9. , 9. ]])
    """
    _, voxel, counts = np.unique(_keys(points, size), return_inverse=True, return_counts=True)
    sums = [np.bincount(voxel, weights=points[:, axis]) for axis in range(3)]
    means: NDArray[np.float64] = np.stack(sums, axis=1) / counts[:, None]
    return means


def _occupied(points: NDArray[np.float32], size: float) -> int:
    keys = np.sort(_keys(points, size))
    return 1 + int(np.count_nonzero(keys[1:] != keys[:-1]))


def _keys(points: NDArray[np.float32], size: float) -> NDArray[np.int64]:
    """One number a voxel, (n,) int64; at a millimetre it holds 2 km each way."""
    cells = np.floor(points / np.float32(size)).astype(np.int64)
    cells -= cells.min(axis=0)
    _, y, z = cells.max(axis=0) + 1
    keys: NDArray[np.int64] = (cells[:, 0] * y + cells[:, 1]) * z + cells[:, 2]
    return keys

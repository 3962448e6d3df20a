"""Reduces a cloud to a fixed number of points, whatever the order of its points."""

import math

import numpy as np
from numpy.typing import NDArray

#: Bounds of voxel sizes, metres: smaller ones separate no points, larger ones hold any scan.
SMALLEST, LARGEST = 1e-3, 1e3

#: The search for a voxel size stops when at most this many times the target count remain.
SURPLUS = 1.01


def spread(n: int, count: int) -> NDArray[np.int64]:
    """``count`` indices spread evenly over 0 to n - 1, in order, (count,) int64.

    Without repetition if n >= count; otherwise each index occurs ⌊count / n⌋ or ⌈count / n⌉ times.

    >>> spread(10, 4)
    array([0, 2, 5, 7])
    """
    return np.arange(count, dtype=np.int64) * n // count


def fixed_count(points: NDArray[np.float32], count: int) -> NDArray[np.float64]:
    """Exactly ``count`` points, spread over the points (n, 3) in metres: (count, 3) float64.

    More points are reduced to voxel means of a cubic grid, whose size is chosen so that slightly
    more than ``count`` remain; the surplus is dropped evenly along the grid. PointNetVLAD's
    published code (mikacuy/pointnetvlad, submap_generation) goes to just below the count instead
    and adds random points. Fewer points are repeated evenly; no points give zeros. Points are
    sorted first, so that their order does not matter.

    >>> fixed_count(np.array([[1, 2, 3]], dtype=np.float32), 2)
    array([[1., 2., 3.],
           [1., 2., 3.]])
    """
    cloud = at_most(points, count)
    return cloud[spread(len(cloud), count)] if len(cloud) else np.zeros((count, 3))


def at_most(points: NDArray[np.float32], count: int) -> NDArray[np.float64]:
    """The points of `fixed_count` without repetitions: (at most count, 3) float64."""
    points = points[np.lexsort(points.T[::-1])]
    size = voxel_size(points, count) if len(points) > count else None
    cloud = points.astype(np.float64) if size is None else voxel_means(points, size)
    return cloud if len(cloud) <= count else cloud[spread(len(cloud), count)]


def voxel_size(points: NDArray[np.float32], count: int) -> float | None:
    """A voxel size, metres, that leaves ``count`` or slightly more of the points (n, 3).

    None if even the smallest voxels leave fewer, i.e. if points coincide. The number of voxels
    decreases with their size, apart from small fluctuations.
    """
    low, high = SMALLEST, LARGEST
    if _occupied(points, low) < count:
        return None
    while high > 1.001 * low:
        middle = math.sqrt(low * high)
        voxels = _occupied(points, middle)
        if voxels < count:
            high = middle
            continue
        low = middle
        if voxels <= SURPLUS * count:
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
    """One number per voxel, (n,) int64; with voxels of 1 mm it is unique within 2 km."""
    cells = np.floor(points / np.float32(size)).astype(np.int64)
    cells -= cells.min(axis=0)
    _, y, z = cells.max(axis=0) + 1
    keys: NDArray[np.int64] = (cells[:, 0] * y + cells[:, 1]) * z + cells[:, 2]
    return keys

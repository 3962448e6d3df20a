"""Euclidean clusters of points, with a tolerance that may grow with the distance from the sensor.

Source: the segmentation of Locus (Vidanapathirana et al., ICRA 2021), which has one tolerance.
"""

import numpy as np
from numpy.typing import NDArray

#: Tolerances from one band of ranges to the next.
_BAND = 1.5

#: The side of the cells in which points are thinned, in tolerances.
_CELL = 0.25


def euclidean_clusters(
    points: NDArray[np.floating], tolerance: float = 0.2, growth: float = 0.0
) -> NDArray[np.int64]:
    """The cluster of each point, (n,), numbered from 0 in the order of their first points.

    Two points belong together if they are within the tolerance of each other, or if a chain of such
    points joins them. At a range ρ, metres from the sensor's axis, the tolerance is max(tolerance,
    growth ρ), for two points the smaller of theirs; the angle between two beams is a ``growth``
    that keeps walls whole. Points are thinned first: those in one cell, whose side is at most a
    quarter of the tolerance, stand at their mean. So two points that are farther apart than the
    tolerance by less than half of it may belong together too, or nearer ones not.

    Args:
        points: (n, 3) metres, the sensor's axis at x = y = 0.
        tolerance: metres.
        growth: metres of tolerance per metre of range.

    >>> points = np.array([[5, 0, 0], [5, 0.15, 0], [5, 0.3, 0], [5, 1, 0]])
    >>> euclidean_clusters(points).tolist()
    [0, 0, 0, 1]
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    exact = points.astype(np.float64)
    cell_of, means = _thinned(exact, tolerance, growth)
    links = _links(means, _tolerances(means, tolerance, growth), tolerance, growth)
    graph = coo_matrix((np.ones(len(links), np.bool_), tuple(links.T)), shape=(len(means),) * 2)
    cluster = connected_components(graph, directed=False)[1][cell_of]
    _, first = np.unique(cluster, return_index=True)
    number = np.empty(len(first), dtype=np.int64)
    number[cluster[np.sort(first)]] = np.arange(len(first))
    numbers: NDArray[np.int64] = number[cluster]
    return numbers


def _tolerances(
    points: NDArray[np.float64], tolerance: float, growth: float
) -> NDArray[np.float64]:
    ranges = np.hypot(points[:, 0], points[:, 1])
    larger: NDArray[np.float64] = np.maximum(tolerance, growth * ranges)
    return larger


def _thinned(
    points: NDArray[np.float64], tolerance: float, growth: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The cell of each point (n,), and the mean of the points of each cell (m, 3)."""
    own = _tolerances(points, tolerance, growth) / tolerance
    band = np.floor(np.log(own) / np.log(_BAND)).astype(np.int64)
    side = _CELL * tolerance * _BAND**band
    cells = np.column_stack([band, np.floor(points / side[:, None]).astype(np.int64)])
    cells -= cells.min(axis=0, initial=0)
    keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0, initial=0) + 1))
    _, cell = np.unique(keys, return_inverse=True)
    counts = np.bincount(cell)
    sums = [np.bincount(cell, weights=column) for column in points.T]
    return cell, np.stack(sums, axis=1) / counts[:, None]


def _links(
    points: NDArray[np.float64], tolerances: NDArray[np.float64], least: float, growth: float
) -> NDArray[np.int64]:
    """Pairs of points (k, 2) that are within the smaller of their tolerances.

    Those whose smaller tolerance lies in one band are found in a tree of the points that have at
    least this tolerance, and at most as much more as such a pair can differ by.
    """
    from scipy.spatial import KDTree

    pairs = [np.empty((0, 2), dtype=np.int64)]
    order = np.argsort(tolerances, kind="stable")
    ordered = tolerances[order]
    largest = float(ordered[-1]) if len(ordered) else 0.0
    low = least
    while low <= largest:
        high = low * _BAND
        # From one point to another the tolerance changes by at most growth times their distance.
        start, stop = np.searchsorted(ordered, [low, (1 + growth) * high])
        some = order[start:stop]
        if len(some) > 1:
            near = some[KDTree(points[some]).query_pairs(min(high, largest), output_type="ndarray")]
            smaller = tolerances[near].min(axis=1)
            apart = np.linalg.norm(points[near[:, 0]] - points[near[:, 1]], axis=1)
            pairs.append(near[(smaller >= low) & (smaller < high) & (apart <= smaller)])
        low = high
    return np.concatenate(pairs)

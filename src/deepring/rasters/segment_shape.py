"""The shape of one segment: turned to its own axes, and as voxels of its own size (SegMap).

Source: SegMap (Dubé et al., RSS 2018; ethz-asl/segmap), whose features Locus takes.
"""

import numpy as np
from numpy.typing import NDArray

Cells = tuple[int, int, int]


def aligned(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Points (n, 3) turned about z, so that they spread most along x.

    Of the two headings that are left, the one in which more points lie below the mean of y than
    above it. The published code looks at y before the turn.

    >>> aligned(np.array([[0.0, 0.0, 1.0], [0.0, 2.0, 5.0]])).round(3).tolist()
    [[0.0, 0.0, 1.0], [2.0, 0.0, 5.0]]
    """
    x, y, z = points.astype(np.float64).T
    dx, dy = x - x.mean(), y - y.mean()
    angle = 0.5 * np.arctan2(2 * (dx * dy).sum(), (dx * dx).sum() - (dy * dy).sum())
    c, s = np.cos(angle), np.sin(angle)
    across = c * dy - s * dx
    if (across > 0).sum() > (across < 0).sum():
        c, s = -c, -s
    return np.column_stack([c * x + s * y, c * y - s * x, z])


def voxels(
    points: NDArray[np.floating], cells: Cells = (32, 32, 16), smallest: float = 0.1
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which voxels of its own grid a segment (n, 3) occupies, and its extents (3,), metres.

    Along each axis the extent fills the cells, or as many as are ``smallest`` metres wide. The
    points' mean is at the middle of the grid, so that the ends of a lopsided segment are cut.

    >>> grid, extents = voxels(np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 0.5]]), (4, 4, 4))
    >>> np.argwhere(grid).tolist(), extents.tolist()
    ([[0, 0, 0], [3, 3, 3]], [3.0, 1.0, 0.5])
    """
    low = points.min(axis=0)
    extents = (points.max(axis=0) - low).astype(np.float64)
    last = np.array(cells) - 1
    places = (points - low) / np.maximum(extents, smallest * np.array(cells)) * last
    places += last / 2 - places.mean(axis=0)
    # What is exactly on the border may round to either side of it.
    index = np.floor(places + 1e-9).astype(np.int64)
    index = index[((index >= 0) & (index <= last)).all(axis=1)]
    grid = np.zeros(cells, dtype=np.bool_)
    grid[tuple(index.T)] = True
    return grid, extents


def hull_points(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """The corners (k, 3) of the convex hull of a segment (n, 3); all points of a flat one."""
    from scipy.spatial import ConvexHull, QhullError

    exact = points.astype(np.float64)
    if len(exact) < 4:
        return exact
    try:
        corners: NDArray[np.float64] = exact[ConvexHull(exact).vertices]
    except QhullError:  # all points in one plane
        return exact
    return corners


def hull_distances(hulls: list[NDArray[np.float64]]) -> NDArray[np.float32]:
    """Smallest distance between corners (k, 3) of each two hulls, (n, n), metres; 0 with itself."""
    from scipy.spatial.distance import cdist

    n = len(hulls)
    distances = np.zeros((n, n), dtype=np.float32)
    if n < 2:
        return distances
    starts = np.cumsum([0] + [len(corners) for corners in hulls])
    everything = np.concatenate(hulls)
    for k, corners in enumerate(hulls[:-1]):
        apart = cdist(corners, everything[starts[k + 1] :]).min(axis=0)
        distances[k, k + 1 :] = np.minimum.reduceat(apart, starts[k + 1 : -1] - starts[k + 1])
    return np.maximum(distances, distances.T)

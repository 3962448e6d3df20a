"""Which segments of different scans are the same thing, told by where they stand in the world."""

import numpy as np
from numpy.typing import NDArray


def in_world(
    centres: NDArray[np.floating],
    positions: NDArray[np.float64],
    headings: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Centres (n, 3) of segments in the world, metres, z above the ground under the sensor.

    Args:
        centres: (n, 3) metres in the frame of the segment's scan.
        positions: (n, 2) metres of that scan.
        headings: (n,) radians of that scan.

    >>> in_world(np.array([[5.0, 0, 1]]), np.array([[10.0, 0]]), np.array([np.pi / 2])).round(3)
    array([[10.,  5.,  1.]])
    """
    c, s = np.cos(headings), np.sin(headings)
    x, y, z = centres.astype(np.float64).T
    return np.column_stack([c * x - s * y + positions[:, 0], s * x + c * y + positions[:, 1], z])


def segment_identities(
    centres: NDArray[np.float64], scans: NDArray[np.int64], radius: float = 1.0
) -> NDArray[np.int64]:
    """The identity of each segment, (n,), numbered from 0; -1 for what a single scan sees.

    An identity is what stands within ``radius`` metres of one of its segments, the anchor, and of
    each scan the segment nearest to it. Anchors are taken in the order of how many segments are
    within the radius of them, each segment at most once; identities are numbered by how many scans
    they are of, the most first.

    Args:
        centres: (n, 3) metres in the world, or more columns that set datasets apart.
        scans: (n,) number of each segment's scan.
        radius: metres.

    >>> centres = np.array([[0, 0, 1], [0.4, 0, 1], [9, 0, 1]], dtype=float)
    >>> segment_identities(centres, np.array([0, 1, 1])).tolist()
    [0, 0, -1]
    """
    from scipy.spatial import KDTree

    n = len(centres)
    identity = np.full(n, -1, dtype=np.int64)
    if not n:
        return identity
    tree = KDTree(centres)
    crowd = tree.query_ball_point(centres, radius, return_length=True)
    free = np.ones(n, dtype=np.bool_)
    groups: list[NDArray[np.int64]] = []
    for anchor in np.argsort(-crowd, kind="stable"):
        if crowd[anchor] < 2:
            break
        if not free[anchor]:
            continue
        near = np.array(tree.query_ball_point(centres[anchor], radius, return_sorted=True))
        near = near[free[near]]
        apart = np.linalg.norm(centres[near] - centres[anchor], axis=1)
        near = near[np.argsort(apart, kind="stable")]
        _, first = np.unique(scans[near], return_index=True)
        members = near[np.sort(first)]
        free[anchor] = False
        if len(members) > 1:
            free[members] = False
            groups.append(members)
    groups.sort(key=len, reverse=True)
    for number, members in enumerate(groups):
        identity[members] = number
    return identity

"""The choice of scans of a session: spacing, first passes and revisits (protocol)."""

import numpy as np
from numpy.typing import NDArray

from deepring.checks import at_least
from deepring.data.regions import HalfPlane

Positions = NDArray[np.float64]
Indices = NDArray[np.int64]


def sample_by_distance(positions: Positions, spacing: float, mask: NDArray[np.bool_]) -> Indices:
    """Indices of the scans that are used, of (n, 2) positions in driving order.

    A scan in the mask is used when its distance from the last used one exceeds ``spacing`` metres;
    the first one in the mask always is. 0 takes all. Raises ConfigError for another spacing.
    """
    at_least("spacing", spacing, 0, "metres")
    indices: list[int] = []
    for index in np.flatnonzero(mask):
        if (
            not indices
            or spacing == 0
            or np.hypot(*(positions[index] - positions[indices[-1]])) > spacing
        ):
            indices.append(int(index))
    return np.array(indices, dtype=np.int64)


def path_lengths(positions: Positions) -> Positions:
    """Metres of path up to each of (n, 2) positions, (n,)."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[: len(positions)]


def revisits(positions: Positions, radius: float = 10.0, apart: float = 100.0) -> NDArray[np.bool_]:
    """Mask (n,) of the scans that pass ground first seen over ``apart`` metres of path earlier.

    Scan i is a revisit when an earlier scan within ``radius`` metres of it lies more than
    ``apart`` metres of driven path before. The others are first passes. Raises ConfigError for a
    radius or distance below 0.
    """
    from scipy.spatial import KDTree

    at_least("radius", radius, 0, "metres")
    at_least("apart", apart, 0, "metres")
    path = path_lengths(positions)
    near = KDTree(positions).query_ball_point(positions, radius)
    return np.array(
        [path[neighbours].min() < path[i] - apart for i, neighbours in enumerate(near)], dtype=bool
    )


def far_half_plane(positions: Positions, share: float) -> HalfPlane:
    """The half-plane that holds the far ``share`` of (n, 2) positions, cut across their longest
    direction: a validation split that needs no coordinates."""
    centre = positions.mean(axis=0)
    axis = np.linalg.svd(positions - centre, full_matrices=False)[2][0]
    axis = axis * np.sign(axis[np.abs(axis).argmax()])  # SVD leaves the sign open
    cut = centre + axis * np.quantile((positions - centre) @ axis, 1.0 - share)
    return HalfPlane((float(cut[0]), float(cut[1])), (float(axis[0]), float(axis[1])))

"""Selects scans of a session by spacing, evenly, first passes and revisits (protocol)."""

import numpy as np
from numpy.typing import NDArray

from deepring.checks import at_least
from deepring.data.regions import HalfPlane

Positions = NDArray[np.float64]
Indices = NDArray[np.int64]


def sample_by_distance(positions: Positions, spacing: float, mask: NDArray[np.bool_]) -> Indices:
    """Indices of spaced scans among (n, 2) positions in driving order.

    Selects the first scan in the mask, and then each one whose distance from the last selected
    one exceeds ``spacing`` metres; 0 selects all. Raises ConfigError for a negative spacing.
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


def sample_of(count: int, most: int) -> list[int]:
    """Up to ``most`` indices below ``count``, spread evenly from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def path_lengths(positions: Positions) -> Positions:
    """Path length (n,), metres, up to each of (n, 2) or (n, 3) positions."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[: len(positions)]


def revisits(positions: Positions, radius: float = 10.0, apart: float = 100.0) -> NDArray[np.bool_]:
    """Mask (n,) of revisits; all other scans are first passes.

    Scan i is a revisit when a scan within ``radius`` metres of it is more than ``apart`` metres of
    driven path earlier. Raises ConfigError for a negative ``radius`` or ``apart``.
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
    """The half-plane with the far ``share`` of (n, 2) positions along their longest direction.

    This gives a validation split without coordinates in the config.
    """
    centre = positions.mean(axis=0)
    axis = np.linalg.svd(positions - centre, full_matrices=False)[2][0]
    axis = axis * np.sign(axis[np.abs(axis).argmax()])  # SVD leaves the sign open
    cut = centre + axis * np.quantile((positions - centre) @ axis, 1.0 - share)
    return HalfPlane((float(cut[0]), float(cut[1])), (float(axis[0]), float(axis[1])))

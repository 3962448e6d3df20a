"""Six features of each point's neighbourhood, which RING++ takes instead of occupancy.

Xu et al. 2023, RING++ (T-RO), whose published code (lus6-Jenny/RING, `generate_bev_feats`) takes
them from LPD-Net (Liu et al. 2019). λ1 >= λ2 >= λ3 are the eigenvalues of the covariance of a
point and its nearest neighbours, μ1 >= μ2 those of its part in x and y:

    curvature     λ3 / (λ1 + λ2 + λ3)                        0 on a line or a plane, 1/3 in a ball
    omnivariance  (λ1 λ2 λ3)^(1/3) / (λ1 + λ2 + λ3)          likewise
    entropy       -Σ p_i log p_i, p_i = λ_i / Σ λ            0 on a line, log 2, log 3
    flatness      μ2 / μ1                                    0 on a wall, 1 if round from above
    reach         largest z - smallest z
    variance      of z

All are invariant to turns about z and to translations.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.arrays import real_array
from deepring.errors import DataError

#: In the order of the channels.
FEATURES = ("curvature", "omnivariance", "entropy", "flatness", "reach", "variance")


def local_features(points: NDArray[Any], neighbours: int = 30) -> NDArray[np.float64]:
    """The features of each of the points (n, 3): (n, 6) float64, in the order of `FEATURES`.

    Lengths are in the unit of the points. 0 / 0 counts as 0, so that a lone point has zeros.

    Args:
        points: (n, 3), finite.
        neighbours: points per neighbourhood, the point itself included; at most n.

    Raises:
        ConfigError: less than one neighbour.
        DataError: no points (n, 3), or some that are not finite.

    >>> wall = np.array([[x, 0, z] for x in range(5) for z in range(5)])
    >>> local_features(wall, 25)[0].round(2).tolist()
    [0.0, 0.0, 0.69, 0.0, 4.0, 2.0]
    """
    from scipy.special import entr

    checks.count("neighbours", neighbours)
    points = finite_points(points)
    if not len(points):
        return np.zeros((0, len(FEATURES)))
    near = points[nearest(points, neighbours)]
    offset = near - near.mean(axis=1, keepdims=True)
    covariance = offset.transpose(0, 2, 1) @ offset / near.shape[1]
    share = shares(np.linalg.eigvalsh(covariance))
    return np.stack(
        [
            share[:, 0],
            np.cbrt(share.prod(axis=1)),
            entr(share).sum(axis=1),
            flatness(*covariance[:, [0, 0, 1], [0, 1, 1]].T),
            np.ptp(offset[:, :, 2], axis=1),
            covariance[:, 2, 2],
        ],
        axis=1,
    )


def nearest(points: NDArray[np.float64], neighbours: int) -> NDArray[np.int64]:
    """Indices of each point's nearest points, itself included: (n, min(neighbours, n)) int64."""
    from scipy.spatial import cKDTree

    count = min(neighbours, len(points))
    indices: NDArray[np.int64] = cKDTree(points).query(points, k=count)[1]
    return indices.reshape(len(points), count)


def finite_points(points: Any) -> NDArray[np.float64]:
    """Points (n, 3) float64. Raises DataError for another shape, and unless all are finite."""
    rows = real_array("points", points)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise DataError(f"points: shape {rows.shape}, expected (n, 3)")
    if not np.isfinite(rows).all():
        raise DataError("points: some are NaN or infinite, expected finite ones; leave them out")
    return np.ascontiguousarray(rows, dtype=np.float64)


def shares(eigenvalues: NDArray[np.float64]) -> NDArray[np.float64]:
    """Eigenvalues (n, 3) over their sum, in the same order; rounding may leave one below 0."""
    positive = np.maximum(eigenvalues, 0.0)
    return ratio(positive, positive.sum(axis=1, keepdims=True))


def flatness(
    xx: NDArray[np.float64], xy: NDArray[np.float64], yy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The smaller over the larger eigenvalue of matrices [[xx, xy], [xy, yy]], each (n,): (n,)."""
    mean = (xx + yy) / 2
    spread = np.hypot((xx - yy) / 2, xy)
    return ratio(np.maximum(mean - spread, 0.0), mean + spread)


def ratio(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Part over whole, 0 where the whole is 0."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)

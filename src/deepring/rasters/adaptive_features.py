"""Ten features of a neighbourhood whose size each point chooses: LPD-Net's.

Liu et al., LPD-Net (ICCV 2019), Sec. 3.1; numbers and scaling as in its published code
(Suoivy/LPD-net, prepare_data and loading_pointclouds). λ1 >= λ2 >= λ3 are the eigenvalues of the
covariance of a point and its k - 1 nearest, Σ their sum, μ1 >= μ2 those of its part in x and y:

    curvature     λ3 / Σ
    omnivariance  (λ1 λ2 λ3)^(1/3) / Σ
    linearity     (λ1 - λ2) / λ1
    entropy       -Σ p_i log p_i, p_i = λ_i / Σ
    density       3 k / (4 π λ1 λ2 λ3)
    scatter       μ1 + μ2
    flatness      μ2 / μ1
    reach         largest z - smallest z
    variance      of z
    upright       |z| of the normal, the unit eigenvector of λ3

k is the size of least entropy of the shares (λ1 - λ2, λ2 - λ3, λ3) / λ1: the one at which the
neighbourhood is most clearly a line, a plane or a ball. All features are invariant to turns about z
and to translations.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.local_features import finite_points, flatness, nearest, ratio, shares

#: In the order of the channels.
ADAPTIVE_FEATURES = (
    *("curvature", "omnivariance", "linearity", "entropy", "density"),
    *("scatter", "flatness", "reach", "variance", "upright"),
)

#: The published sizes of neighbourhoods.
SIZES = (20, 30, 40, 50, 60, 70, 80, 90, 100)


def adaptive_features(points: NDArray[Any], sizes: Sequence[int] = SIZES) -> NDArray[np.float64]:
    """The features of each of the points (n, 3): (n, 10) float64, in `ADAPTIVE_FEATURES`' order.

    Lengths are in the unit of the points. 0 / 0 counts as 0; the density of a plane is infinite.
    Where there are fewer points than a size, that size is all of them.

    Args:
        points: (n, 3), finite.
        sizes: points per neighbourhood, the point itself included, increasing.

    Raises:
        ConfigError: sizes that do not increase, or less than one.
        DataError: no points (n, 3), or some that are not finite.

    >>> wall = np.array([[x, 0, z] for x in range(5) for z in range(5)])
    >>> adaptive_features(wall, [25])[0].round(2).tolist()
    [0.0, 0.0, 0.0, 0.69, inf, 2.08, 0.0, 4.0, 2.0, 0.0]
    """
    from scipy.special import entr

    moments, axis = chosen_neighbourhoods(points, sizes)
    values, (xx, xy, yy, reach, variance, size) = moments[:, :3], moments[:, 3:].T
    share = shares(values)
    with np.errstate(divide="ignore", over="ignore"):
        density = 3 * size / (4 * np.pi * values.prod(axis=1))
    return np.stack(
        [
            share[:, 2],
            np.cbrt(share.prod(axis=1)),
            ratio(values[:, 0] - values[:, 1], values[:, 0]),
            entr(share).sum(axis=1),
            density,
            xx + yy,
            flatness(xx, xy, yy),
            reach,
            variance,
            np.abs(axis[:, 2]),
        ],
        axis=1,
    )


def chosen_neighbourhoods(
    points: NDArray[Any], sizes: Sequence[int] = SIZES
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The moments (n, 9) and normals (n, 3) of the neighbourhoods that the points (n, 3) choose.

    Moments are λ1 >= λ2 >= λ3, the covariance's xx, xy and yy, the range of z, its variance, and
    the size. Raises what `adaptive_features` raises.
    """
    checked = check_sizes("sizes", sizes)
    points = finite_points(points)
    moments, axis = np.zeros((len(points), 9)), np.zeros((len(points), 3))
    if len(points):
        from deepring.rasters import _neighbourhood_kernels

        near = nearest(points, checked[-1])
        within = np.unique(np.minimum(checked, len(points)))
        _neighbourhood_kernels.chosen_neighbourhoods(points, near, within, moments, axis)
    return moments, axis


def scaled(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Features (n, 10), each but the last from 0, its least in the cloud, to 1, its largest.

    The largest is that of the finite ones, and infinite ones are 1. A feature that is the same for
    all points is 0. So the unit of length does not matter.

    >>> scaled(np.array([[1.0, 0.5], [3.0, 0.5], [2.0, 0.7]])).tolist()
    [[0.0, 0.5], [1.0, 0.5], [0.5, 0.7]]
    """
    values = features[:, :-1]
    finite = np.isfinite(values)
    least = np.where(finite, values, np.inf).min(axis=0, initial=np.inf)
    most = np.where(finite, values, -np.inf).max(axis=0, initial=-np.inf)
    span = np.where(most > least, most - least, 0.0)
    shifted = np.subtract(values, least, out=np.zeros_like(values), where=finite)
    result = np.where(finite, ratio(shifted, np.broadcast_to(span, shifted.shape)), 1.0)
    return np.column_stack([result, features[:, -1]])


def check_sizes(name: str, sizes: Sequence[int]) -> NDArray[np.int64]:
    """The sizes as they are. Raises ConfigError unless they are whole numbers that increase."""
    given = checks.widths(name, sizes)
    if any(later <= size for size, later in pairwise(given)):
        raise ConfigError(f"{name}: {list(given)}, expected numbers that increase, such as 20, 30")
    return np.array(given, dtype=np.int64)

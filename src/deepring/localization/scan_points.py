"""Check of a scan's points before its pose is computed."""

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError


def expect_scan(name: str, points: NDArray[np.floating]) -> NDArray[np.floating]:
    """The points (n, 3) or wider, unchanged.

    Raises DataError for another shape, for no points at all, and for coordinates that are not
    finite.
    """
    if points.ndim != 2 or points.shape[1] < 3 or not len(points):
        raise DataError(
            f"{name}: shape {points.shape}, expected (n, 3) with at least one point; leave such "
            "a scan out"
        )
    bad = int((~np.isfinite(points[:, :3])).any(axis=1).sum())
    if bad:
        raise DataError(
            f"{name}: {bad} of {len(points)} points have coordinates that are not finite, "
            "expected metres; drop these points"
        )
    return points

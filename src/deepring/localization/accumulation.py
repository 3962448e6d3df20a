"""Consecutive scans joined to one by odometry, where a sensor is narrow or sparse."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import moved_points
from deepring.data.scans.point_times import TimedPoints
from deepring.data.session import Points
from deepring.localization.drives.odometry import Odometry, OdometrySettings

#: Share of a scan's points that must lie within `NEAR` metres of the scans that it is joined with.
#: Of pairs of scans of different places, registered all the same, it is 0.28 to 0.76 (KITTI, a
#: campus, a city; whole and 70° of them), of scans 1 to 2 m apart 0.81 or more but for 2 of 99.
OVERLAP, NEAR = 0.8, 1.0

#: Points of a scan that tell its overlap.
_SOME = 2000

#: The odometry's own overlap is with more than the scans that are joined, and asked by them here.
_ODOMETRY = OdometrySettings(overlap=0.0)


class Accumulator:
    """Joins each scan of a drive with those before it.

    Args:
        count: scans that are joined, this one among them; the first ones have fewer.

    Raises ConfigError for a ``count`` below 1, and where kiss-icp is not installed.
    """

    def __init__(self, count: int) -> None:
        self.count = checks.count("accumulate", count)
        self.interruptions = 0
        """How often a scan did not follow the one before it, so that nothing was joined to it."""
        self._odometry = Odometry(_ODOMETRY)
        self._past: deque[tuple[NDArray[np.float64], Points]] = deque(maxlen=self.count - 1)

    def join(self, scan: TimedPoints, stamp: int | None = None) -> Points:
        """The points (n, 3) of the last scans in the frame of this one.

        A scan that does not overlap with those before it begins anew.

        Args:
            scan: see `Odometry.register`.
            stamp: nanoseconds.

        Raises BrokenScanError as `Odometry.register` does.
        """
        step = self._odometry.register(scan, stamp)
        world_from_scan, points = step.pose, step.points
        before = [
            moved_points(past, np.linalg.inv(world_from_scan) @ pose).astype(np.float32)
            for pose, past in self._past
        ]
        if before and _overlap(points, np.concatenate(before)) < OVERLAP:
            self.interruptions += 1
            self._odometry = Odometry(_ODOMETRY)
            self._past.clear()
            before, points = [], scan.points
            world_from_scan = self._odometry.register(scan, stamp).pose
        self._past.append((world_from_scan, points))
        return np.concatenate([*before, points])


def _overlap(points: Points, others: Points) -> float:
    """Share of the points (n, 3) that lie within `NEAR` metres of others (m, 3)."""
    from scipy.spatial import KDTree

    some = points[:: max(1, len(points) // _SOME)]
    distances, _ = KDTree(others).query(some, distance_upper_bound=NEAR)
    return float(np.isfinite(distances).mean())

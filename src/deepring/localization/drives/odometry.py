"""Odometry: the poses of a drive from its scans alone, by KISS-ICP.

Vizzo et al., KISS-ICP: In Defense of Point-to-Point ICP, RA-L 2023.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import moved_points
from deepring.data.poses.stamps import NANOSECONDS
from deepring.data.scans.point_times import TimedPoints
from deepring.data.session import Points
from deepring.errors import BrokenScanError
from deepring.localization.drives.deskewing import deskewed, motion_over

#: Points that a scan needs in range. Real sensors give thousands.
FEWEST_POINTS = 100
#: Metres around the sensor, in which the overlap is measured: there both are dense.
_AROUND = 40.0
#: Points of the local map and of the scan that tell the overlap, taken evenly from more.
_MAP_POINTS, _SCAN_POINTS = 40_000, 500
#: Periods over which the last velocity is taken for the present one.
_MOST_PERIODS = 3.0
#: Scans after which a local map is dense enough for its overlap to tell anything.
SETTLED = 5


@dataclass(frozen=True)
class OdometrySettings:
    """Settings of the odometry; metres."""

    max_range: float = 100.0
    """Points farther off are not registered. The side of a voxel is a hundredth of it."""
    min_range: float = 1.0
    """Points nearer are not registered: the vehicle itself."""
    overlap: float = 0.6
    """Share of a scan's points near the sensor that must lie within half a voxel of the local map;
    with less the odometry is lost. Measured are 0.76 and more along drives of three sensors, and
    0.38 to 0.47 behind the three jumps of KITTI 00's southern part."""

    def __post_init__(self) -> None:
        checks.positive("odometry.max_range", self.max_range, "metres")
        checks.between("odometry.min_range", self.min_range, 0, self.max_range, "metres")
        checks.between("odometry.overlap", self.overlap, 0, 1)


class OdometryStep(NamedTuple):
    """What the odometry makes of one scan."""

    pose: NDArray[np.float64]
    """(4, 4), first scan's frame <- this scan's, at its stamp."""
    points: Points
    """(n, 3) float32, deskewed if times are known."""
    lost: bool
    """Whether the motion since the scan before is not known: the pose is where a constant velocity
    leads, and a new local map begins."""
    deskewed: bool


class Odometry:
    """Registers scans one after the other. Raises ConfigError where kiss-icp is not installed."""

    def __init__(self, settings: OdometrySettings | None = None) -> None:
        self.settings = settings or OdometrySettings()
        self._library = kiss_icp()
        self._stamp: int | None = None
        self._seconds: float | None = None  # of the last motion, if it is known
        self._begin(np.eye(4))

    def register(self, scan: TimedPoints, stamp: int | None = None) -> OdometryStep:
        """The pose of the next scan.

        Points are deskewed by the velocity between the last two scans, so that all are where they
        would be at the stamp. Scans must follow each other so closely that most of each lies
        within the surroundings of the last: 10 to 20 Hz, or every metre or two.

        Args:
            scan: points in the sensor's frame, z up, and their times.
            stamp: nanoseconds; without, points are not deskewed.

        Raises BrokenScanError, and forgets the scan, if it has less than `FEWEST_POINTS` points in
        range.
        """
        distances = np.linalg.norm(scan.points, axis=1)
        low, high = self.settings.min_range, self.settings.max_range
        inside = int(np.count_nonzero((distances > low) & (distances < high)))
        if inside < FEWEST_POINTS:
            raise BrokenScanError(
                f"{inside} points between {low:g} and {high:g} m, expected at least {FEWEST_POINTS}"
            )
        points, moved = self._deskew(scan, stamp)
        seconds = self._seconds_since(stamp)
        if seconds is not None and self._seconds is not None:  # scans between may be missing
            share = min(seconds / self._seconds, _MOST_PERIODS)
            self._kiss.last_delta = motion_over(np.asarray(self._kiss.last_delta), share)
        predicted = self._kiss.last_pose @ self._kiss.last_delta
        map_points = self._kiss.local_map.point_cloud() if self._scans >= SETTLED else None
        frame = np.ascontiguousarray(points, dtype=np.float64)
        _, source = self._kiss.register_frame(frame, np.empty(0))
        pose = np.asarray(self._kiss.last_pose)
        lost = not np.isfinite(pose).all() or (
            map_points is not None
            and _overlap(source, pose, map_points, high / 200) < self.settings.overlap
        )
        if lost:
            self._begin(self._origin @ predicted)
            self._kiss.register_frame(frame, np.empty(0))
        self._scans += 1
        self._seconds, self._stamp = seconds, stamp
        pose = self._origin @ np.asarray(self._kiss.last_pose)
        return OdometryStep(pose, points, lost, moved)

    def _begin(self, origin: NDArray[np.float64]) -> None:
        """Begin a new local map at a pose."""
        self._origin = origin
        self._kiss = self._library(self.settings)
        self._scans = 0
        self._seconds = None

    def _seconds_since(self, stamp: int | None) -> float | None:
        if stamp is None or self._stamp is None or stamp <= self._stamp:
            return None
        return (stamp - self._stamp) / NANOSECONDS

    def _deskew(self, scan: TimedPoints, stamp: int | None) -> tuple[Points, bool]:
        if scan.times is None or stamp is None:
            return scan.points, False
        if self._seconds is None:  # the velocity is not known yet, and taken for 0
            return scan.points, True
        motion = motion_over(np.asarray(self._kiss.last_delta), 1 / self._seconds)
        return deskewed(scan.points, scan.times, motion), True


def _overlap(
    source: NDArray[np.float64],
    pose: NDArray[np.float64],
    map_points: NDArray[np.float64],
    reach: float,
) -> float:
    """Share of points (n, 3) of a scan near the sensor that lie within reach of a local map."""
    from scipy.spatial import KDTree

    near = source[np.abs(source).max(axis=1) < _AROUND]
    near = near[:: max(1, len(near) // _SCAN_POINTS)]
    around = map_points[(np.abs(map_points - pose[:3, 3]) < _AROUND + reach).all(axis=1)]
    around = around[:: max(1, len(around) // _MAP_POINTS)]
    if not len(near) or not len(around):
        return 0.0
    tree = KDTree(around, balanced_tree=False, compact_nodes=False)
    distances, _ = tree.query(moved_points(near, pose), distance_upper_bound=reach)
    return float(np.isfinite(distances).mean())


def kiss_icp() -> Any:
    """Makes the library's odometry of `OdometrySettings`. ConfigError if it is not installed."""
    checks.installed("odometry", "kiss_icp.kiss_icp", "kiss-icp", "odometry")
    from kiss_icp.config import KISSConfig
    from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
    from kiss_icp.kiss_icp import KissICP

    def make(settings: OdometrySettings) -> Any:
        config = KISSConfig(
            # The library deskews to the end of a sweep; poses here are those of the stamps.
            data=DataConfig(
                max_range=settings.max_range, min_range=settings.min_range, deskew=False
            ),
            mapping=MappingConfig(voxel_size=settings.max_range / 100),
            # In several threads sums differ from run to run.
            registration=RegistrationConfig(max_num_threads=1),
        )
        return KissICP(config)

    return make

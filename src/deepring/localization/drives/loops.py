"""Loop closures of a drive: each scan is compared with past scans only, as on a robot."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import planar_pose, wrap_angle, yaw_after_turn, yaw_of
from deepring.data.left_out import LeftOut, usable_scans
from deepring.data.session import Points, Session
from deepring.errors import DataError
from deepring.localization.drives.loop_graph import Loop, LoopGraph
from deepring.localization.location import AcceptanceThresholds, Location
from deepring.localization.map import Map
from deepring.localization.observation import Observation, described, occupancy
from deepring.localization.place_points import PlacePoints, thinned_points
from deepring.localization.registration.pose_covariance import in_sensor_frame
from deepring.localization.registration.refinement import RefinementSettings, refine, small_gicp
from deepring.progress import Progress

#: When to trust a loop. A wrong loop costs a back end more than a missed one, and keyframes 2 m
#: apart give each return many chances: the largest fit, in hundredths, that keeps 98 % of the
#: returns of four simulated drives (`benchmarks/loops.py --keep 0.98`).
LOOP_THRESHOLDS = AcceptanceThresholds(fit=0.32)


@dataclass(frozen=True)
class LoopSettings:
    """Which scans are keyframes, and which past keyframes each is compared with; metres."""

    spacing: float = 2.0
    """Distance between keyframes."""
    recent: float = 50.0
    """Shortest path between the two scans of a loop."""
    refinement: RefinementSettings | None = None
    """How loops are refined on the points of their scans; None does not refine them."""

    def __post_init__(self) -> None:
        checks.at_least("loops.spacing", self.spacing, 0, "metres")
        checks.positive("loops.recent", self.recent, "metres")
        if self.refinement is not None:
            checks.of_type("loops.refinement", self.refinement, RefinementSettings)


class LoopFinder:
    """Looks keyframes up among the past ones, one after the other.

    Args:
        place_map: a map without places, whose network, thresholds and ground are used; it is
            filled. See `LOOP_THRESHOLDS`: a map's usual thresholds are for places further apart.
        settings: distances, and refinement.
        points_of: gives the points of an earlier keyframe, for the refinement. Without, those of
            all are kept in memory, thinned as `PlacePoints` says.

    Raises DataError for a map with places, and ConfigError for refinement without its library.
    """

    def __init__(
        self,
        place_map: Map,
        settings: LoopSettings | None = None,
        points_of: Callable[[int], Points] | None = None,
    ) -> None:
        settings = LoopSettings() if settings is None else settings
        checks.of_type("place_map", place_map, Map)
        checks.of_type("settings", settings, LoopSettings)
        if settings.refinement is not None:
            small_gicp()  # now rather than at the first loop
        if len(place_map):
            raise DataError(f"map: holds {len(place_map)} places, expected none; give a new one")
        self.map, self.settings = place_map, settings
        self.loops: list[Loop] = []
        self.poses: list[NDArray[np.float64]] = []
        self._path: list[float] = []
        self._kept = PlacePoints()
        self._points_of = points_of

    def see(self, name: str, points: Points) -> Observation:
        """Image and descriptor of a scan. Raises BrokenScanError if it shows nothing."""
        image = occupancy(name, points, self.map.ground_z, self.map.raster)
        return described(self.map.network, image[None])

    def add(self, name: str, points: Points, seen: Observation, pose: NDArray[np.float64]) -> None:
        """Look the next keyframe up, and add it to the past.

        ``pose`` (4, 4) may drift: it gives the path driven, and which candidates contradict.
        """
        step = np.linalg.norm(pose[:2, 3] - self.poses[-1][:2, 3]) if self.poses else 0.0
        path = (self._path[-1] if self._path else 0.0) + float(step)
        past = int(np.searchsorted(self._path, path - self.settings.recent))
        if past:
            location = self.map.localize_observation(seen, before=past)
            if location.trusted:
                self.loops.append(self._loop(location, points))
        self.map.add_observation(seen, pose[None], [name], [points])
        self.poses.append(pose)
        self._path.append(path)
        if self.settings.refinement is not None and self._points_of is None:
            self._kept.add([thinned_points(points)])

    def _loop(self, location: Location, points: Points) -> Loop:
        earlier = location.place
        loop = _planar_loop(len(self.poses), location, self.poses[earlier])
        if self.settings.refinement is None:
            return loop
        other = self._points_of(earlier) if self._points_of else self._kept.of(earlier)
        return _refine(loop, points, other, self.settings.refinement)


def find_loops(
    session: Session,
    place_map: Map,
    settings: LoopSettings | None = None,
    progress: Progress | None = None,
    left_out: LeftOut | None = None,
) -> LoopGraph:
    """Go through a drive once, and look each keyframe up among the past ones.

    Args:
        session: the drive. Its poses may drift: they give the path driven, and which candidates
            contradict each other.
        place_map: see `LoopFinder`; it stays empty if there is an error.
        settings: distances, and refinement.
        progress: called with keyframes done and their total.
        left_out: receives the scans that cannot be used, which are otherwise logged.

    Raises DataError for a map with places and where too many scans cannot be used (see
    `deepring.data.left_out`), and ConfigError for refinement without its library.
    """
    settings = LoopSettings() if settings is None else settings
    checks.of_type("session", session, Session)
    keyframes: list[int] = []
    finder = LoopFinder(place_map, settings, lambda k: session.points(keyframes[k]))

    def see(scan: int) -> tuple[Points, Observation]:
        points = session.points(scan)
        return points, finder.see(str(session.files[scan]), points)

    with place_map.all_or_nothing():
        for scan, (points, seen) in usable_scans(
            session, settings.spacing, see, left_out, progress
        ):
            finder.add(session.files[scan].name, points, seen, session.poses[scan])
            keyframes.append(scan)
    stamps = None if session.stamps is None else session.stamps[keyframes]
    return LoopGraph(np.array(keyframes), session.poses[keyframes], stamps, finder.loops)


def _planar_loop(keyframe: int, location: Location, pose: NDArray[np.float64]) -> Loop:
    """A location in the world as a loop, from the earlier keyframe at ``pose``."""
    heading = float(yaw_of(pose))
    dx, dy = location.x - pose[0, 3], location.y - pose[1, 3]
    c, s = np.cos(heading), np.sin(heading)
    yaw = wrap_angle(location.yaw - heading)
    transform = planar_pose(c * dx + s * dy, c * dy - s * dx, yaw)
    return Loop(keyframe, location.place, transform, location.fit, location.ratio)


def _refine(loop: Loop, points: Points, earlier: Points, settings: RefinementSettings) -> Loop:
    turn = yaw_after_turn(0.0, loop.yaw)
    result = refine(points, earlier, turn, (loop.x, loop.y), settings)
    return replace(
        loop,
        transform=result.transform,
        inliers=result.inliers,
        refined=result.converged,
        covariance=in_sensor_frame(result.covariance, result.transform)
        if result.converged
        else None,
    )

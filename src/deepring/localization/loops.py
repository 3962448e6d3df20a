"""Loop closures of a drive: each scan is compared with past scans only, as on a robot."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import wrap_angle, yaw_after_turn, yaw_of
from deepring.data.left_out import LeftOut, usable_scans
from deepring.data.session import Points, Session
from deepring.data.spacing import path_lengths
from deepring.errors import DataError
from deepring.localization.location import AcceptanceThresholds, Location
from deepring.localization.map import Map
from deepring.localization.observation import Observation, described, occupancy
from deepring.localization.refinement import RefinementSettings, refine, small_gicp
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


@dataclass(frozen=True)
class Loop:
    """Pose of a keyframe in the frame of an earlier one."""

    keyframe: int
    earlier: int
    x: float
    """Metres, of the keyframe's sensor in the earlier one's frame."""
    y: float
    yaw: float
    """Heading of the keyframe in the earlier one's frame, radians in [-π, π)."""
    fit: float
    ratio: float
    inliers: float | None = None
    """Share of points that match after refinement; None without refinement."""
    refined: bool = False
    """Whether x, y and yaw are refined; where refinement failed, they are the alignment's."""


@dataclass(frozen=True, eq=False)
class LoopGraph:
    """Keyframes of a drive and the loops among them."""

    scans: NDArray[np.int64]
    """(n,) numbers of the keyframes in their session."""
    poses: NDArray[np.float64]
    """(n, 4, 4) poses of the session, world <- scan."""
    stamps: NDArray[np.int64] | None
    """(n,) nanoseconds, or None."""
    loops: list[Loop]


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
        place_map: a map without places, whose network, thresholds and ground are used; it is
            filled, unless there is an error. See `LOOP_THRESHOLDS`: a map's usual thresholds are
            for places further apart.
        settings: distances, and refinement.
        progress: called with keyframes done and their total.
        left_out: receives the scans that cannot be used, which are otherwise logged.

    Raises DataError for a map with places and where too many scans cannot be used (see
    `deepring.data.left_out`), and ConfigError for refinement without its library.
    """
    settings = LoopSettings() if settings is None else settings
    checks.of_type("session", session, Session)
    checks.of_type("place_map", place_map, Map)
    checks.of_type("settings", settings, LoopSettings)
    if settings.refinement is not None:
        small_gicp()  # now rather than at the first loop
    if len(place_map):
        raise DataError(f"map: holds {len(place_map)} places, expected none; give a new one")
    with place_map.all_or_nothing():
        return _look_back(session, place_map, settings, progress, left_out)


def _look_back(
    session: Session,
    place_map: Map,
    settings: LoopSettings,
    progress: Progress | None,
    left_out: LeftOut | None,
) -> LoopGraph:
    def see(scan: int) -> tuple[Points, Observation]:
        points = session.points(scan)
        image = occupancy(str(session.files[scan]), points, place_map.ground_z, place_map.raster)
        return points, described(place_map.network, image[None])

    path = path_lengths(session.positions)
    keyframes: list[int] = []
    loops: list[Loop] = []
    for scan, (points, seen) in usable_scans(session, settings.spacing, see, left_out, progress):
        past = int(np.searchsorted(path[keyframes], path[scan] - settings.recent))
        if past:
            location = place_map.localize_observation(seen, before=past)
            if location.trusted:
                earlier = keyframes[location.place]
                loop = _loop(len(keyframes), location, session.poses[earlier])
                if settings.refinement is not None:
                    loop = _refine(loop, points, session.points(earlier), settings.refinement)
                loops.append(loop)
        keyframes.append(scan)
        names = [session.files[scan].name]
        place_map.add_observation(seen, session.poses[scan : scan + 1], names)
    stamps = None if session.stamps is None else session.stamps[keyframes]
    return LoopGraph(np.array(keyframes), session.poses[keyframes], stamps, loops)


def _loop(keyframe: int, location: Location, pose: NDArray[np.float64]) -> Loop:
    """A location in the world as a loop, from the earlier keyframe at ``pose``."""
    heading = float(yaw_of(pose))
    dx, dy = location.x - pose[0, 3], location.y - pose[1, 3]
    c, s = np.cos(heading), np.sin(heading)
    return Loop(
        keyframe,
        location.place,
        float(c * dx + s * dy),
        float(c * dy - s * dx),
        wrap_angle(location.yaw - heading),
        location.fit,
        location.ratio,
    )


def _refine(
    loop: Loop,
    points: NDArray[np.float32],
    earlier: NDArray[np.float32],
    settings: RefinementSettings,
) -> Loop:
    turn = yaw_after_turn(0.0, loop.yaw)
    result = refine(points, earlier, turn, (loop.x, loop.y), settings)
    x, y = (float(value) for value in result.position)
    return replace(
        loop,
        x=x,
        y=y,
        yaw=yaw_after_turn(0.0, result.turn),
        inliers=result.inliers,
        refined=result.converged,
    )

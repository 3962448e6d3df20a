"""Maps of drives: one place per so many metres, of scans with poses."""

from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.data.left_out import LeftOut, usable_scans
from deepring.data.poses.trajectory import Trajectory
from deepring.data.recording import Recording, readable_scans
from deepring.data.session import Points, Session
from deepring.errors import BrokenScanError, DataError
from deepring.localization.map import BATCH, Map
from deepring.localization.observation import described, occupancy
from deepring.methods.deepring import DeepRing
from deepring.progress import Progress

#: Metres between places.
SPACING = 10.0

#: Seconds within which a recording's scan has a pose before and one after it.
TOLERANCE_S = 0.1


class SeenPlace(NamedTuple):
    """A place that is going to be added to a map."""

    name: str
    pose: NDArray[np.float64]
    """(4, 4) world <- scan, metres."""
    image: NDArray[np.bool_]
    """(n, n) occupancy from above."""
    points: Points | None
    """(n, 3) metres in the scan's frame; None for a map that keeps none."""


def build_map(
    session: Session,
    network: DeepRing,
    spacing: float = SPACING,
    ground_z: float = 0.0,
    progress: Progress | None = None,
    left_out: LeftOut | None = None,
    **settings: Any,
) -> Map:
    """A map of a session.

    Args:
        session: see `add_session`.
        network: see `Map`.
        spacing: see `add_session`.
        ground_z: see `Map`.
        progress: see `add_session`.
        left_out: see `add_session`.
        settings: the others of `Map`.

    Raises ConfigError and DataError as `add_session` does.
    """
    checks.of_type("session", session, Session)
    place_map = Map(network, ground_z, **settings)
    add_session(place_map, session, spacing, progress, left_out)
    return place_map


def add_session(
    place_map: Map,
    session: Session,
    spacing: float = SPACING,
    progress: Progress | None = None,
    left_out: LeftOut | None = None,
) -> None:
    """Add places of a session to a map, all or none, one per ``spacing`` metres.

    Args:
        place_map: the map, whose world is that of the session's poses.
        session: the scans and their poses.
        spacing: metres between places; 0 takes each scan.
        progress: called with the numbers of places done and wanted.
        left_out: receives the scans that cannot be used, which are otherwise logged.

    Raises ConfigError for a negative spacing, and DataError where too many scans cannot be used;
    see `deepring.data.left_out`.
    """
    checks.of_type("place_map", place_map, Map)
    checks.of_type("session", session, Session)

    def see(k: int) -> SeenPlace:
        file = session.files[k]
        return seen_place(place_map, file.name, str(file), session.poses[k], session.points(k))

    places = usable_scans(session, spacing, see, left_out, progress)
    add_places(place_map, (place for _, place in places))


def add_recording(
    place_map: Map,
    recording: Recording,
    trajectory: Trajectory,
    spacing: float = SPACING,
    progress: Progress | None = None,
    left_out: LeftOut | None = None,
) -> None:
    """Add places of a recording to a map, all or none, one per ``spacing`` metres.

    Args:
        place_map: the map, whose world is that of the trajectory.
        recording: the scans, which are read one at a time.
        trajectory: poses of the sensor, world <- scan, by stamps.
        spacing: metres between places; 0 takes each scan.
        progress: called with the numbers of scans gone through and of all.
        left_out: receives the scans that cannot be used.

    A scan has a pose if the trajectory has one before and one after it, `TOLERANCE_S` away at most.
    A scan whose stamp is not later than those before cannot be used.

    Raises ConfigError for a negative spacing, and DataError for scans without stamps, if none has a
    pose, and where too many scans cannot be used.
    """
    checks.of_type("place_map", place_map, Map)
    checks.at_least("spacing", spacing, 0, "metres")
    counted = LeftOut() if left_out is None else left_out
    counted.what, counted.total = f"recording {recording.name}", len(recording)
    add_places(place_map, _recorded(place_map, recording, trajectory, spacing, progress, counted))


def _recorded(
    place_map: Map,
    recording: Recording,
    trajectory: Trajectory,
    spacing: float,
    progress: Progress | None,
    left_out: LeftOut,
) -> Iterator[SeenPlace]:
    last: NDArray[np.float64] | None = None
    latest: int | None = None
    done = known = late = 0
    damage: list[str] = []
    for scan in readable_scans(recording, damage):
        done += 1
        if progress is not None:
            progress(done, max(done, len(recording)))
        if scan.stamp is None:
            raise DataError(
                f"recording {recording.name}: scan {scan.name} has no stamp, expected stamps for "
                "poses with stamps"
            )
        if latest is not None and scan.stamp <= latest:
            late += 1
            left_out.add(
                f"{scan.name}: its stamp is not later than those before, expected the time of each "
                "scan in its order"
            )
            continue
        latest = scan.stamp
        (pose,), (valid,) = trajectory.interpolate([scan.stamp], TOLERANCE_S)
        if not valid:
            continue
        known += 1
        if last is not None and spacing and np.hypot(*(pose[:2, 3] - last)) <= spacing:
            continue
        try:
            place = seen_place(place_map, scan.name, scan.name, pose, scan.read().points)
        except BrokenScanError as error:
            left_out.add(str(error))
            continue
        last = pose[:2, 3]
        yield place
    for message in damage:
        left_out.add(message)
    left_out.without_pose = done - known - late
    if last is None:
        raise DataError(
            f"recording {recording.name}: {known} of {done} scans have a pose within "
            f"{TOLERANCE_S:g} s and none can be used; expected poses of the same drive and clock"
        )


def seen_place(
    place_map: Map, name: str, source: str, pose: NDArray[np.float64], points: Points
) -> SeenPlace:
    """What a map keeps of a scan, which ``source`` names. Raises BrokenScanError as `occupancy`."""
    image = occupancy(source, points, place_map.ground_z, place_map.raster)
    return SeenPlace(name, pose, image, None if place_map.points is None else points)


def add_places(place_map: Map, places: Iterator[SeenPlace]) -> None:
    """Describe places and add them to a map, all or none."""
    with place_map.all_or_nothing():
        while batch := list(islice(places, BATCH)):
            names, poses, images, points = zip(*batch, strict=True)
            seen = described(place_map.network, np.stack(images))
            place_map.add_observation(seen, np.stack(poses), names, points)

"""Loops of one drive: deepring beside map-closures, with the same poses.

deepring looks each keyframe up among those of the past. map-closures makes local maps of 100 m out
of all scans and closes loops between these; here they are built with the drive's poses in place of
its odometry. A closure is right where the pose that it states is less than 2 m and 5° from that of
the drive's poses: of two keyframes, or of two local maps' origins. A keyframe revisits where it is
within 10 m of one at least 50 m of path before; a local map revisits where one of its keyframes
does. Recall is the share of revisiting keyframes that have a right loop, or lie in a local map that
has one. In reach are those whose place lies in a local map that map-closures may propose.
"""

import importlib.util
import time
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from loops import BESIDE, NEAR, RIGHT, trials_of
from peer_pairs import errors
from peer_table import Share

from deepring.data.readers import ground_of, list_sessions, open_session
from deepring.data.session import Session
from deepring.data.spacing import path_lengths
from deepring.localization.drives.loops import LOOP_THRESHOLDS, LoopGraph, LoopSettings, find_loops
from deepring.localization.map import Map
from deepring.methods.deepring import DeepRing

#: map-closures never proposes the three local maps before the present one.
SKIPPED = 3


@dataclass(frozen=True)
class LoopRow:
    """One method on one drive."""

    data: str
    method: str
    of: str
    """What loops are closed between, and how many there are."""
    loops: int
    right: Share
    """Loops within 2 m and 5°."""
    right_to_4_m: Share
    """Loops within 4 m and 5°: poses drift too."""
    keyframes_found: Share
    """Of those that revisit."""
    maps_found: Share | None
    """Of the local maps that revisit."""
    in_reach: Share | None
    """Of the keyframes that revisit a local map that map-closures may propose."""
    ms: float
    """Processor time of a keyframe or a local map."""
    seconds: float
    """Processor time of the drive."""


class Closure(NamedTuple):
    """A local map seen again in a later one."""

    earlier: int
    later: int
    pose: np.ndarray
    """(4, 4) earlier <- later."""


def measured_loops(name: str, root: str, network: DeepRing) -> list[LoopRow]:
    """Both methods on the first session of a dataset."""
    format = name.removeprefix("sim_")
    session = open_session(format, root, list_sessions(format, root)[0])
    settings = LoopSettings()
    started = time.process_time()
    place_map = Map(network, ground_of(session, format), thresholds=LOOP_THRESHOLDS)
    graph = find_loops(session, place_map, settings)
    seconds = time.process_time() - started
    path = path_lengths(session.positions)
    revisiting = revisits(graph.poses[:, :2, 3], path[graph.scans], settings.recent)
    rows = [_deepring_row(name, graph, path, settings, revisiting, seconds)]
    if importlib.util.find_spec("map_closures"):
        started = time.process_time()
        closures, borders = map_closures(session)
        seconds = time.process_time() - started
        scans = {int(graph.scans[k]): graph.scans[past] for k, past in revisiting.items()}
        rows.append(closures_row(name, session, closures, borders, scans, seconds))
    return rows


def revisits(positions: np.ndarray, path: np.ndarray, recent: float) -> dict[int, np.ndarray]:
    """Keyframes within 10 m of others at least ``recent`` metres of path before, with these."""
    found = {}
    for k, until in enumerate(np.searchsorted(path, path - recent)):
        away = np.linalg.norm(positions[:until] - positions[k], axis=1)
        if (away <= NEAR).any():
            found[k] = np.flatnonzero(away <= NEAR)
    return found


def map_closures(session: Session) -> tuple[list[Closure], list[tuple[int, int]]]:
    """Closures, and the scans [first, end) of each local map: map-closures' own pipeline with its
    own settings, the session's poses in place of its odometry."""
    from map_closures.config import MapClosuresConfig
    from map_closures.map_closures import MapClosures
    from map_closures.voxel_map import VoxelMap

    reach, config = 100.0, MapClosuresConfig()
    finder = MapClosures(config)
    local = VoxelMap(config.density_map_resolution, reach)
    closures, borders = [], []
    origin, start = session.poses[0], 0
    for k in range(len(session.files)):
        pose = np.linalg.inv(origin) @ session.poses[k]
        local.integrate_frame(session.points(k), pose)
        if np.linalg.norm(pose[:3, 3]) <= reach and k < len(session.files) - 1:
            continue
        for found in finder.get_closures(len(borders), local.point_cloud()):
            if found.number_of_inliers > config.inliers_threshold:
                stated = np.linalg.inv(np.asarray(found.pose))  # it gives later <- earlier
                closures.append(Closure(found.source_id, found.target_id, stated))
        borders.append((start, k + 1))
        local.remove_far_away_points(pose[:3, 3])
        kept = local.point_cloud()
        local.clear()
        local.integrate_frame(kept, np.linalg.inv(pose))
        origin, start = session.poses[k], k
    return closures, borders


def closures_row(
    name: str,
    session: Session,
    closures: list[Closure],
    borders: list[tuple[int, int]],
    revisiting: dict[int, np.ndarray],
    seconds: float,
) -> LoopRow:
    """Closures of local maps beside the poses; ``revisiting`` as of `revisits`, in scans."""
    right, beside, found = [], [], set()
    for earlier, later, pose in closures:
        a, b = (session.poses[borders[k][0]] for k in (earlier, later))
        off, degrees = errors(pose, np.linalg.inv(a) @ b)
        right.append(off < RIGHT.metres and degrees < RIGHT.degrees)
        beside.append(off < BESIDE.metres and degrees < BESIDE.degrees)
        if right[-1]:
            found.add(later)
    # A scan on the border of two maps ends the first and begins the second.
    map_of = partial(np.searchsorted, [end for _, end in borders], side="right")
    where = {scan: int(map_of(scan)) for scan in revisiting}
    held = sum(one in found for one in where.values())
    reach = [
        where[scan] in found
        for scan, past in revisiting.items()
        if (where[scan] - map_of(past) > SKIPPED).any()
    ]
    maps = set(where.values())
    return LoopRow(
        name,
        "map-closures",
        f"{len(borders)} local maps",
        len(closures),
        Share(int(np.sum(right)), len(right)),
        Share(int(np.sum(beside)), len(beside)),
        Share(held, len(revisiting)),
        Share(len(maps & found), len(maps)),
        Share(sum(reach), len(reach)),
        round(seconds / len(borders) * 1e3, 1),
        round(seconds, 1),
    )


def _deepring_row(
    name: str,
    graph: LoopGraph,
    path: np.ndarray,
    settings: LoopSettings,
    revisiting: dict[int, np.ndarray],
    seconds: float,
) -> LoopRow:
    trials = trials_of(graph, path[graph.scans], settings.recent)
    right, beside = trials.correct(RIGHT), trials.correct(BESIDE)
    closed = np.array([loop.keyframe for loop in graph.loops], dtype=np.int64)
    held = np.isin(list(revisiting), closed[right])
    return LoopRow(
        name,
        "deepring",
        f"{len(graph.scans)} keyframes",
        len(right),
        Share(int(right.sum()), len(right)),
        Share(int(beside.sum()), len(beside)),
        Share(int(held.sum()), len(held)),
        None,
        None,
        round(seconds / len(graph.scans) * 1e3, 1),
        round(seconds, 1),
    )

"""Two maps as one: the frame of the second is found in the first by locating its places there."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import planar_pose
from deepring.data.spacing import sample_of
from deepring.errors import DataError
from deepring.localization.common_frame import common_frame
from deepring.localization.map import BATCH, Map
from deepring.localization.observation import Observation, described
from deepring.progress import Progress

#: Places of the second map that are located in the first, spread evenly.
MOST = 500


class FoundFrame(NamedTuple):
    """The frame of a map in another one."""

    pose: NDArray[np.float64]
    """(4, 4) first <- second. Both have z up: it turns about z alone."""
    tried: int
    """Places of the second map that were looked up in the first."""
    located: int
    """Of these, places whose location is trusted."""
    agreeing: int
    """Of these, places that agree with the pose."""
    error: float
    """Median distance between where these were located and where the pose puts them, metres."""


def find_frame(first: Map, second: Map, progress: Progress | None = None) -> FoundFrame:
    """The frame of the ``second`` map in the ``first``.

    Raises DataError for maps whose images are of different rasters, for maps without places, and
    where too few places agree; see `deepring.localization.common_frame`.
    """
    checks.of_type("first", first, Map)
    checks.of_type("second", second, Map)
    if first.raster != second.raster:
        raise DataError(
            f"second: its images are of {second.raster}, expected {first.raster}, as of the first "
            "map; build it again with the first one's network"
        )
    if not (len(first) and len(second)):
        raise DataError("maps: one holds no places, expected places in both")
    places = np.array(sample_of(len(second), MOST))
    rows, located, grounds = [], [], []
    if first.places.names == second.places.names and np.array_equal(
        first.places.poses, second.places.poses
    ):
        raise DataError("maps: both hold the same places, expected maps of two drives or clouds")
    heights, ours = first.places.poses[:, 2, 3], second.places.poses[:, 2, 3]
    planar = second.places.planar_poses(torch.from_numpy(places)).numpy()
    for done, k in enumerate(places):
        location = first.localize_observation(_seen(first, second, places[done : done + 1]))
        if location.trusted:
            rows.append(done)
            located.append((location.x, location.y, location.yaw))
            ground = heights[location.place] + first.ground_z
            grounds.append(ground - ours[k] - second.ground_z)
        if progress is not None:
            progress(done + 1, len(places))
    there = np.array(located).reshape(-1, 3)
    try:
        frame, agree = common_frame(planar[rows], there)
    except DataError as error:
        raise DataError(
            f"maps: {len(rows)} of {len(places)} places of the second are found in the first; "
            f"{error}: they may not overlap, or be of different scale"
        ) from error
    expected = frame.applied(planar[rows][agree])
    z = float(np.median(np.array(grounds)[agree]))
    return FoundFrame(
        planar_pose(frame.x, frame.y, frame.yaw, z),
        len(places),
        len(rows),
        int(agree.sum()),
        float(np.median(np.linalg.norm(expected[:, :2] - there[agree, :2], axis=1))),
    )


def merged(
    first: Map,
    second: Map,
    frame: FoundFrame,
    prefix: str = "",
    progress: Progress | None = None,
) -> Map:
    """A map of the places of both, in the frame of the ``first`` and described by its network.

    Poses of the second become those of sensors as high above the ground as the first one's. The
    new map keeps points if both do.

    Args:
        first: the map whose network, settings and thresholds the new one has.
        second: the map whose places are moved.
        frame: see `find_frame`.
        prefix: stands before the names of the second one's places.
        progress: called with the numbers of places done and wanted.
    """
    points = first.points is not None and second.points is not None
    both = Map(
        first.network, first.ground_z, first.index.settings, first.rerank, first.thresholds, points
    )
    both.doubts = tuple(dict.fromkeys((*first.doubts, *second.doubts)))
    sources = ((first, np.eye(4), ""), (second, frame.pose, prefix))
    total = len(first) + len(second)
    for source, pose, before in sources:
        lift = np.eye(4)
        lift[2, 3] = source.ground_z - first.ground_z
        poses = pose @ source.places.poses @ lift
        for start in range(0, len(source), BATCH):
            part = np.arange(start, min(start + BATCH, len(source)))
            names = [before + source.places.names[k] for k in part]
            clouds = None
            if points and source.points is not None:
                clouds = [_lowered(source.points.of(int(k)), lift[2, 3]) for k in part]
            both.add_observation(_seen(first, source, part), poses[part], names, clouds)
            if progress is not None:
                progress(len(both), total)
    return both


def _seen(first: Map, source: Map, places: NDArray[np.int64]) -> Observation:
    """Places of a map as the first one's network sees them."""
    images = source.places.images(torch.from_numpy(places)).numpy().astype(np.bool_)
    return described(first.network, images)


def _lowered(points: NDArray[np.float32], lift: float) -> NDArray[np.float32]:
    """Points (n, 3), seen from ``lift`` metres further up."""
    return points - np.array([0.0, 0.0, lift], dtype=np.float32)

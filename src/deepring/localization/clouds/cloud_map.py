"""Maps out of point clouds: each place is what a sensor would see there."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring import checks
from deepring.core.rigid import pose_from
from deepring.data.clouds.plausibility import expect_plausible
from deepring.data.clouds.tiles import TiledCloud
from deepring.errors import BrokenScanError, DataError
from deepring.localization.clouds.path_places import path_places
from deepring.localization.clouds.standing_places import standing_places
from deepring.localization.clouds.virtual_scan import VirtualSensor, virtual_scan
from deepring.localization.map import Map
from deepring.localization.map_building import SeenPlace, add_places, seen_place
from deepring.methods.deepring import DeepRing
from deepring.progress import Progress, progress_bar

#: Metres between places along a path, and on a grid where the path is not known.
PATH_SPACING, GRID_SPACING = 10.0, 5.0

#: A virtual scan's points cover so many of the cloud's spacings: gaps of surfaces are filled.
COVERED = 2.0


@dataclass(frozen=True)
class CloudMap:
    """A map of a cloud, and what was left out."""

    map: Map
    left_out: tuple[str, ...]
    """Why places were left out, one line for each kind."""


def map_of_cloud(
    cloud: TiledCloud,
    network: DeepRing,
    sensor: VirtualSensor | None = None,
    spacing: float | None = None,
    path: NDArray[np.float64] | None = None,
    **settings: Any,
) -> CloudMap:
    """A map of a cloud for a sensor.

    Args:
        cloud: the points, in metres, z up.
        network: describes the places.
        sensor: that with which scans are going to be located.
        spacing: metres between places, `PATH_SPACING` or `GRID_SPACING` by default.
        path: (n, 3) positions that were driven, in the cloud's coordinates; without it, places are
            put where the ground was seen.
        settings: the others of `Map`.

    Poses of the places are in the cloud's coordinates, level, x along the cloud's x. Raises
    ConfigError for a spacing that is not above 0, and DataError for a cloud in another unit, one
    in which z does not point up, one without ground, and for a path that does not lie in it.
    """
    sensor = sensor or VirtualSensor()
    if spacing is None:
        spacing = GRID_SPACING if path is None else PATH_SPACING
    checks.positive("spacing", spacing, "metres")
    place_map = Map(network, -sensor.height, **settings)
    apart = expect_plausible(cloud)
    left_out: list[str] = []
    names, grounds = _places(cloud, sensor, spacing, apart, path, left_out)
    with progress_bar("describing places") as bar:
        places = _seen(cloud, place_map, sensor, apart, names, grounds, left_out, bar)
        add_places(place_map, places)
    if not len(place_map):
        raise DataError(f"cloud {cloud.source}: no place can be used: {left_out[0]}")
    low, high = sensor.fov
    place_map.source = (
        f"cloud {Path(cloud.source).name}, {cloud.points} points, places "
        f"{'on a grid' if path is None else 'along a path'}, seen {sensor.height:g} m above the "
        f"ground from {low:g} to {high:g} degrees"
    )
    return CloudMap(place_map, tuple(left_out))


def _places(
    cloud: TiledCloud,
    sensor: VirtualSensor,
    spacing: float,
    apart: float,
    path: NDArray[np.float64] | None,
    left_out: list[str],
) -> tuple[list[str], NDArray[np.float64]]:
    """Names of places, and their positions (k, 3) on the ground."""
    with progress_bar("looking for the ground") as bar:
        if path is not None:
            along = path_places(cloud, path, spacing, bar)
            if along.off:
                left_out.append(f"{along.off} places of the path: no ground of the cloud beneath")
            return [f"pose_{row + 1}" for row in along.rows.tolist()], along.positions
        grounds = standing_places(cloud, sensor.height, spacing, apart, bar)
    if not len(grounds):
        raise DataError(
            f"cloud {cloud.source}: no ground was seen on which a sensor {sensor.height:g} m high "
            "could stand; expected level ground with free space above it, z up: give `path`, or "
            "check the cloud"
        )
    return [f"place_{k:06}" for k in range(len(grounds))], grounds


def _seen(
    cloud: TiledCloud,
    place_map: Map,
    sensor: VirtualSensor,
    apart: float,
    names: list[str],
    grounds: NDArray[np.float64],
    left_out: list[str],
    progress: Progress,
) -> Iterator[SeenPlace]:
    """What is seen from each place; those of which nothing stands out are left out."""
    blank: list[str] = []
    up = np.array([0.0, 0.0, sensor.height])
    for k, (name, ground) in enumerate(zip(names, grounds, strict=True)):
        position = ground + up
        scan = virtual_scan(cloud, position, COVERED * apart, sensor)
        try:
            yield seen_place(place_map, name, name, pose_from(np.eye(3), position), scan)
        except BrokenScanError as error:
            blank.append(str(error))
        progress(k + 1, len(names))
    if blank:
        left_out.append(f"{len(blank)} of {len(names)} places; first: {blank[0]}")

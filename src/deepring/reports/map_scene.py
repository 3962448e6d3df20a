"""A map, and the scans located in it, as a scene."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from deepring.core.rigid import FloatArray, moved_points
from deepring.data.clouds.voxels import first_rows
from deepring.localization.map import Map
from deepring.localization.place_points import STEP
from deepring.reports.located_scan import LocatedScan, cell_centres, located_pose
from deepring.reports.round_origin import round_origin
from deepring.reports.scene import BLUE, GREEN, GREY, ORANGE, RED, Lines, Points, Scene, on_screen

#: Side of the voxels of the map's points, metres, since places see the same things.
_VOXEL = 0.5

#: Heights that colours run over, metres above the ground of a place.
_TOP = 12.0


def map_scene(place_map: Map, paths: Sequence[FloatArray] = ()) -> Scene:
    """The places, their points or what their images show, and the paths (n, 3) that were driven."""
    shapes = _map_shapes(place_map)
    if paths:
        shapes.append(Lines("map/path", paths, BLUE, on_screen(1.0)))
    return Scene(f"map {place_map.source}".strip(), shapes, _origin(place_map))


def locations_scene(place_map: Map, scans: Sequence[LocatedScan]) -> Scene:
    """The places, and where each scan is; its points are green if it is trusted."""
    shapes: list[Points | Lines] = _map_shapes(place_map)
    poses = [located_pose(scan, place_map) for scan in scans]
    for step, (scan, pose) in enumerate(zip(scans, poses, strict=True)):
        colour = GREEN if scan.location.trusted else ORANGE
        at = pose[None, :3, 3]
        label = f"{scan.name}: {scan.location.doubt or 'trusted'}"
        shapes.append(Points("scan/position", at, colour, on_screen(5.0), [label], step))
        if scan.points is not None:
            points = moved_points(scan.points.astype(np.float64) * STEP, pose)
            shapes.append(Points("scan/points", points, colour, 0.08, (), step))
    for name, colour, trusted in (("trusted", GREEN, True), ("doubtful", ORANGE, False)):
        found = [
            p[:3, 3] for p, s in zip(poses, scans, strict=True) if s.location.trusted == trusted
        ]
        if found:
            shapes.append(Points(f"located/{name}", np.array(found), colour, on_screen(3.0)))
    errors = [
        np.stack([pose[:3, 3], [*scan.pose[:2, 3], pose[2, 3]]])
        for scan, pose in zip(scans, poses, strict=True)
        if scan.pose is not None
    ]
    if errors:
        shapes.append(Lines("located/to_the_true_position", errors, RED, on_screen(1.0)))
    return Scene(f"scans in the map {place_map.source}".strip(), shapes, _origin(place_map))


def _origin(place_map: Map) -> FloatArray:
    positions = place_map.places.poses[:, :3, 3]
    return round_origin(positions) if len(positions) else np.zeros(3)


def _map_shapes(place_map: Map) -> list[Points | Lines]:
    if not len(place_map):
        return []
    poses = place_map.places.poses
    parts = list(_seen(place_map, poses))
    points = np.concatenate([points for points, _ in parts])
    heights = np.concatenate([heights for _, heights in parts])
    rows = first_rows(points, _VOXEL)
    return [
        Points("map/points", points[rows], _colours(heights[rows]), 0.12),
        Points("map/places", poses[:, :3, 3], GREY, on_screen(2.5), place_map.places.names),
    ]


def _seen(place_map: Map, poses: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """What each place shows, (n, 3) in the world, and its heights above the ground, (n,)."""
    kept = place_map.points
    for place, pose in enumerate(poses):
        if kept is not None:
            points = kept.of(place).astype(np.float64)
        else:
            (image,) = place_map.places.images(torch.tensor([place])).numpy()
            cells = cell_centres(image.astype(np.bool_), place_map.raster.extent)
            points = np.column_stack([cells, np.full(len(cells), place_map.ground_z)])
        yield moved_points(points, pose), points[:, 2] - place_map.ground_z


def _colours(heights: FloatArray) -> NDArray[np.uint8]:
    """(n, 3), from dark blue on the ground to light yellow above."""
    share = np.clip(heights / _TOP, 0.0, 1.0)[:, None]
    low, high = np.array([60.0, 80.0, 140.0]), np.array([250.0, 230.0, 120.0])
    return (low + share * (high - low)).astype(np.uint8)

"""The whole pose of a scan in a map: its points registered on those of the places around it."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch

from deepring import checks
from deepring.core.rigid import FloatArray, moved_points, planar_pose, yaw_of
from deepring.errors import DataError
from deepring.localization.location import Location
from deepring.localization.place_points import PlacePoints
from deepring.localization.registration.pose_covariance import direction_name, turned
from deepring.localization.registration.refinement import RefinementSettings, register, settled
from deepring.localization.scan_points import scan_points

if TYPE_CHECKING:
    from deepring.localization.map import Map

#: Places within this of a scan are registered on, metres, and at most so many of them.
AROUND, PLACES = 12.0, 5

#: Least share of a scan's points within reach of the map's.
FEW_INLIERS = 0.3

PoseDoubt = Literal["not converged", "few inliers", "location"]
"""Why a refined pose is not to be relied on: the registration did not settle near the location;
less than `FEW_INLIERS` of the points match; the location that it started from is not trusted."""


@dataclass(frozen=True)
class RefinedPose:
    """The whole pose of a scan; that of the location, unless ``converged``."""

    pose: FloatArray
    """(4, 4) world <- scan, metres."""
    covariance: FloatArray
    """(6, 6) of x, y, z, roll, pitch, yaw along the world's axes, metres and radians; see
    `deepring.localization.registration.pose_covariance`."""
    unobservable: FloatArray
    """(k, 6) unit directions along the world's axes, rotations times 10 m, that no surface
    holds: their standard deviation exceeds 0.5 m."""
    inliers: float
    """Share of the scan's thinned points that match."""
    converged: bool
    """Whether the registration settled near the location."""
    doubt: PoseDoubt | None
    """Why not to rely on it; None if nothing speaks against it."""

    @property
    def x(self) -> float:
        """Metres, in the world of the map's poses."""
        return float(self.pose[0, 3])

    @property
    def y(self) -> float:
        """Metres."""
        return float(self.pose[1, 3])

    @property
    def z(self) -> float:
        """Metres, of the sensor."""
        return float(self.pose[2, 3])

    @property
    def roll_pitch_yaw(self) -> tuple[float, float, float]:
        """Radians: the rotation is Rz(yaw) Ry(pitch) Rx(roll)."""
        r = self.pose[:3, :3]
        roll, yaw = math.atan2(r[2, 1], r[2, 2]), float(yaw_of(r))
        return roll, -math.asin(min(1.0, max(-1.0, float(r[2, 0])))), yaw

    @property
    def unobservable_names(self) -> list[str]:
        """The directions that no surface holds, such as "along 12°" or "yaw"."""
        return [direction_name(direction) for direction in self.unobservable]


def refined_pose(
    place_map: "Map",
    points: Any,
    location: Location,
    ground_z: float | None,
    settings: RefinementSettings,
) -> RefinedPose:
    """Register a scan on the points of a map; see `Map.refine`."""
    kept = _points_of(place_map)
    scan = scan_points("scan", points).astype(np.float64)
    ground_z = place_map.ground_z if ground_z is None else checks.number("ground_z", ground_z)
    near = _places_around(place_map, location)
    poses = place_map.places.poses[near]
    # The points are registered in the frame of the place: coordinates of a world may be large.
    anchor = poses[0]
    start = np.linalg.inv(anchor) @ _start(anchor, location, place_map.ground_z - ground_z)
    shared = []
    for place, pose in zip(near.tolist(), np.linalg.inv(anchor) @ poses, strict=True):
        shared.append(moved_points(kept.of(place), pose))
    reference = np.concatenate(shared)
    if not len(reference):
        raise DataError(
            f"map: place {location.name} has no points within reach to register on; expected some"
        )
    found = settled(register(scan, reference, start, settings), start, settings)
    wide = np.kron(np.eye(2), anchor[:3, :3])
    return RefinedPose(
        pose=anchor @ found.transform,
        covariance=turned(found.covariance, anchor[:3, :3]),
        unobservable=found.unobservable @ wide.T,
        inliers=found.inliers,
        converged=found.converged,
        doubt=_doubt(found.converged, found.inliers, location.trusted),
    )


def _points_of(place_map: "Map") -> PlacePoints:
    """The points of a map's places. Raises DataError for a map without them."""
    if place_map.points is None:
        raise DataError("map: holds no points to register on; expected them; build it with points")
    return place_map.points


def _places_around(place_map: "Map", location: Location) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The place of a location, and the nearest others to the scan, up to `PLACES` (k,)."""
    every = place_map.places.planar_poses(torch.arange(len(place_map)))[:, :2].numpy()
    away = np.hypot(*(every - [location.x, location.y]).T)
    away[location.place] = -1.0
    nearest = np.argsort(away, kind="stable")[:PLACES]
    return np.asarray(nearest[away[nearest] <= AROUND], dtype=np.int64)


def _start(place: FloatArray, location: Location, higher: float) -> FloatArray:
    """World <- scan (4, 4): the place's height and tilt, moved and turned along its ground."""
    level = planar_pose(place[0, 3], place[1, 3], float(yaw_of(place)))
    there = planar_pose(location.x, location.y, location.yaw)
    start = place @ np.linalg.inv(level) @ there
    start[:3, 3] += higher * place[:3, 2]
    return np.asarray(start)


def _doubt(converged: bool, inliers: float, trusted: bool) -> PoseDoubt | None:
    if not converged:
        return "not converged"
    if inliers < FEW_INLIERS:
        return "few inliers"
    return None if trusted else "location"

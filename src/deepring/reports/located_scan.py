"""A scan that was located in a map, with what a page or a viewer shows of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import planar_pose
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.reports.lie import Lie, lie_of


@dataclass(frozen=True, eq=False)
class LocatedScan:
    """A location, and the scan itself."""

    name: str
    location: Location
    image: NDArray[np.uint8]
    """Packed occupancy from above, see `deepring.data.packed_rasters`."""
    pose: NDArray[np.float64] | None = None
    """(4, 4) the true pose in the map's world, if it is known."""
    points: NDArray[np.int16] | None = None
    """(n, 3) of the scan, thinned, see `thinned_points`; None where nobody shows them."""
    ground_z: float = 0.0
    """z of the ground in the scan's frame, metres."""
    refined: NDArray[np.float64] | None = None
    """(4, 4) world <- scan, the refined pose, if there is one that can be relied on."""


def located_pose(scan: LocatedScan, place_map: Map) -> NDArray[np.float64]:
    """Pose (4, 4), world <- scan: the refined one, or as located, level, on the place's ground."""
    if scan.refined is not None:
        return scan.refined
    found = scan.location
    place = place_map.places.poses[found.place]
    height = place[2, 3] + place_map.ground_z - scan.ground_z
    return planar_pose(found.x, found.y, found.yaw, height)


def cell_centres(image: NDArray[np.bool_], extent: float) -> NDArray[np.float64]:
    """Positions (k, 2) of the occupied cells of an image (n, n), metres in the scan's frame.

    >>> cell_centres(np.array([[False, True], [False, False]]), extent=2.0)  # behind, to the left
    array([[-1.,  1.]])
    """
    centres = (np.argwhere(image) + 0.5) * (2 * extent / len(image)) - extent
    return centres.astype(np.float64)


def lie_in_place(location: Location, place: NDArray[np.float64]) -> Lie:
    """How a located scan lies on its place, whose x, y and yaw (3,) in the world are given.

    Metres and radians.
    """
    of_place = planar_pose(*map(float, place))
    return lie_of(np.linalg.inv(of_place) @ planar_pose(location.x, location.y, location.yaw))

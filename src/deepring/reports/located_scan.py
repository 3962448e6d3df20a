"""A scan that was located in a map, with what a page or a viewer shows of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import planar_pose, rotation_from_rpy
from deepring.localization.location import Location
from deepring.localization.map import Map


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


def cells_in_place(
    image: NDArray[np.bool_], extent: float, location: Location, place: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The occupied cells (k, 2) of a located scan in its place's frame, metres.

    Args:
        image: (n, n) of the scan.
        extent: half the side of the image, metres.
        location: of the scan.
        place: (3,) x, y and yaw of the place in the world, metres and radians.
    """
    shift = _turned(np.array([[location.x, location.y]]) - place[:2], -float(place[2]))
    return _turned(cell_centres(image, extent), location.yaw - float(place[2])) + shift


def _turned(positions: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    rotation = rotation_from_rpy(0.0, 0.0, turn)[:2, :2]
    turned: NDArray[np.float64] = positions @ rotation.T
    return turned

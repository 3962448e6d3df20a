"""Maps of a few places, and scans taken between them, of one world of walls."""

import numpy as np

from deepring.core.rigid import pose_from, rotation_from_rpy
from deepring.data.packed_rasters import pack
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.reports.located_scan import LocatedScan
from helpers.networks import small_network
from helpers.scenes import scattered

#: x, y and yaw of the places of `small_map`, metres and radians.
PLACES = np.array([[0.0, 0.0, 0.0], [12.0, 4.0, 0.7], [30.0, -5.0, -2.0]])

GROUND_Z = -1.5


def pose(x, y, yaw, z=0.0):
    return pose_from(rotation_from_rpy(0.0, 0.0, yaw), [x, y, z])


def seen_at(x, y, yaw):
    """What a sensor sees there, at `GROUND_Z` above the ground: points in its own frame."""
    world = scattered(3)
    return (world - [x, y, 0.0]) @ rotation_from_rpy(0.0, 0.0, yaw) + [0.0, 0.0, GROUND_Z]


def small_map(names=("a.npy", "b.npy", "c.npy"), offset=(0.0, 0.0), points=False):
    place_map = Map(small_network(), GROUND_Z, points=points)
    scans = [seen_at(*place) for place in PLACES]
    poses = [pose(x + offset[0], y + offset[1], yaw, z=10.0) for x, y, yaw in PLACES]
    place_map.add(scans, poses, names)
    place_map.source = "drive <b>one</b>"
    return place_map


def location(place=0, x=0.0, y=0.0, yaw=0.0, doubt=None, name="a.npy", fit=0.5, ratio=2.0):
    return Location(place, name, x, y, yaw, 0.9, fit, ratio, 400, doubt is None, doubt)


def located(place_map, name, found, true=None, points=None):
    """A scan taken where it was located, whose pose is said to be ``true`` (x, y, yaw)."""
    image = place_map.observe([seen_at(found.x, found.y, found.yaw)]).images[0]
    packed = pack(image, place_map.raster)
    known = None if true is None else pose(*true)
    return LocatedScan(name, found, packed, known, points, GROUND_Z)

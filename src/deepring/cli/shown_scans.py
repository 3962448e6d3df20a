"""The located scans that the page and the viewer of `deepring localize` show."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from numpy.typing import NDArray

from deepring.cli.looking import is_shown, is_viewed, show_scene, write_page
from deepring.data.packed_rasters import pack
from deepring.data.poses.stamps import stamps_in_names
from deepring.data.session import Points
from deepring.localization.location import Location
from deepring.localization.map import Map
from deepring.localization.observation import Observation
from deepring.localization.place_points import thinned_points
from deepring.localization.refined_pose import RefinedPose
from deepring.localization.scan_points import scan_points
from deepring.reports.located_scan import LocatedScan
from deepring.reports.map_scene import locations_scene


class ShownScans:
    """Keeps of each scan what is shown of it; nothing where the options ask for nothing."""

    def __init__(self, args: argparse.Namespace, place_map: Map) -> None:
        self.args, self.place_map = args, place_map
        self._scans: list[LocatedScan] = []

    def add(
        self,
        name: str,
        stamp: int | None,
        refined: RefinedPose | None,
        location: Location,
        seen: Observation,
        points: Points,
        ground_z: float | None,
        pose: NDArray | None,
    ) -> None:
        """Keep one scan."""
        if not is_shown(self.args):
            return
        named = stamps_in_names([Path(name)])
        if stamp is not None and (named is None or named[0] != stamp):
            name = f"{name} {stamp}"
        image = pack(seen.images[0], self.place_map.raster)
        thinned = thinned_points(scan_points(name, points)) if is_viewed(self.args) else None
        if ground_z is None:
            ground_z = self.place_map.ground_z
        whole = None if refined is None or refined.doubt is not None else refined.pose
        self._scans.append(LocatedScan(name, location, image, pose, thinned, ground_z, whole))

    def show(self, refused: Sequence[str]) -> None:
        """Write the page, show the scene and write its file, as the options ask for."""
        if self.args.page is not None:
            from deepring.reports.locations_page import locations_page  # figures: slow to import

            name = self.args.map.name
            write_page(self.args, locations_page(name, self.place_map, self._scans, refused))
        show_scene(self.args, lambda: locations_scene(self.place_map, self._scans))

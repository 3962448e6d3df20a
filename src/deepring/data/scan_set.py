"""A selection of scans of a session, prepared for a method."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import pose_from, rotation_from_rpy, turn_points, yaw_of
from deepring.data.session import Session
from deepring.errors import BrokenScanError
from deepring.rasters import Raster


@dataclass(frozen=True, eq=False)
class ScanSet:
    """A selection of scans of a session, in order.

    ``ground_z`` is the z of the ground under the sensor in the scan's frame (metres); ``turns``
    (n,) radians turn each scan before it is rasterized; None turns none.
    """

    session: Session
    indices: NDArray[np.int64]
    ground_z: float = 0.0
    turns: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions (n, 2), metres."""
        return self.session.positions[self.indices]

    @property
    def ground_truth(self) -> NDArray[np.float64]:
        """Ground-truth positions (n, 2), in the dataset's coordinates."""
        return self.session.ground_truth[self.indices]

    @property
    def headings(self) -> NDArray[np.float64]:
        """Yaw of the scan frames in the world (n,), radians, counter-clockwise, before any turn."""
        return yaw_of(self.session.poses[self.indices])

    @property
    def frames(self) -> NDArray[np.float64]:
        """World poses (n, 4, 4) of the frames of the scans' rasters.

        These have the axes of the scan after its turn, and their origin on the nominal ground.
        """
        turns = np.zeros(len(self)) if self.turns is None else self.turns
        down = [[0.0, 0.0, self.ground_z]]
        seen = pose_from(rotation_from_rpy(0.0, 0.0, -turns), np.tile(down, (len(self), 1)))
        return self.session.poses[self.indices] @ seen

    def subset(self, mask: NDArray[np.bool_]) -> "ScanSet":
        """The scans where ``mask`` (n,) is True."""
        turns = None if self.turns is None else self.turns[mask]
        return ScanSet(self.session, self.indices[mask], self.ground_z, turns)

    def rasterize(self, k: int, raster: Raster) -> NDArray[Any]:
        """Read and rasterize scan ``k`` of the set.

        Raises BrokenScanError if it cannot be read, and if nothing of it is seen in the raster.
        """
        index = int(self.indices[k])
        points = self.session.points(index, raster.columns)
        if self.turns is not None:
            turned = turn_points(points[:, :3], float(self.turns[k]))
            points = np.column_stack([turned, points[:, 3:]]) if raster.columns else turned
        image = raster(points, self.ground_z)
        if raster.is_blank(image):
            reason = raster.why_blank(points, self.ground_z)
            raise BrokenScanError(f"{self.session.files[index]}: {reason}")
        return image

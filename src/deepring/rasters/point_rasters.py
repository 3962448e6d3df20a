"""The rasters that are sets rather than images: points and cylindrical voxels of a fixed number.

Their shape is fixed, as the cache demands, and they depend on the points but not on their order.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DeepringError
from deepring.rasters.downsample import fixed_count, spread
from deepring.rasters.preprocessing import Preprocessing
from deepring.rasters.raster_checks import check_crop, check_fields
from deepring.rasters.voxels import PADDING, cylindrical_voxels, sectors_of


def within(points: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """The points (n, 3) less than ``radius`` metres from the z axis, (m, 3)."""
    return points[np.hypot(points[:, 0], points[:, 1]) < radius]


@dataclass(frozen=True)
class PointsRaster:
    """PointNetVLAD's input: ``count`` points in [-1, 1]; see `deepring.rasters.downsample`.

    Points beyond the disc of ``extent`` metres are left out, as the BEV's mask does, and all
    three coordinates are divided by ``extent``: z = 1 is ``extent`` above the ground, and shapes
    keep their proportions. The original (Uy and Lee 2018, Sec. 5) moves submaps of 20 m to their
    centroid and scales them to a mean distance of 0.5; here the sensor stays the origin, and the
    scale is the same for all scans. A scan without points gives zeros.
    """

    count: int = 4096
    extent: float = 70.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("count",), ("extent",))
        check_crop(self, self.extent)
        low, high = self.preprocessing.height
        if max(-low, high) > self.extent:
            raise DeepringError(
                f"preprocessing.height: {[low, high]}, expected heights within ±{self.extent:g} m, "
                "the raster.extent by which the PointsRaster scales z into [-1, 1]"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """(point, xyz)."""
        return (self.count, 3)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Half precision: off by at most 1.7 cm at 70 m, 9 mm below 35 m, and so on by halves."""
        return np.dtype(np.float16)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.float16]:
        """Points in units of ``extent``, (count, 3) float16, z above the ground."""
        kept = within(self.preprocessing(points, ground_z), self.extent)
        return (fixed_count(kept, self.count) / self.extent).astype(np.float16)


@dataclass(frozen=True)
class VoxelRaster:
    """Occupied cylindrical voxels (θ, r, z), padded to ``max_voxels`` rows.

    The indices and their order are those of `deepring.rasters.voxels.cylindrical_voxels`, of the
    points less than ``radius`` metres away; the rows after the last are filled with
    `deepring.rasters.voxels.PADDING`, which no index is. Where a scan has more than ``max_voxels``,
    rows spread evenly over that order are kept: every direction loses the same share.
    """

    max_voxels: int = 16384
    degrees: float = 1.0
    ring: float = 0.3
    height: float = 0.2
    radius: float = 70.0
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    def __post_init__(self) -> None:
        check_fields(self, ("max_voxels",), ("ring", "height", "radius"))
        check_crop(self, self.radius)
        sectors_of(self.degrees)

    @property
    def shape(self) -> tuple[int, int]:
        """(voxel, (θ, r, z))."""
        return (self.max_voxels, 3)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Indices."""
        return np.dtype(np.int16)

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.int16]:
        """Indices of the occupied voxels, then padding, (max_voxels, 3) int16."""
        kept = within(self.preprocessing(points, ground_z), self.radius)
        voxels = cylindrical_voxels(kept, self.degrees, self.ring, self.height)
        if len(voxels) > self.max_voxels:
            voxels = voxels[spread(len(voxels), self.max_voxels)]
        rows = np.full(self.shape, PADDING, dtype=np.int16)
        rows[: len(voxels)] = voxels
        return rows

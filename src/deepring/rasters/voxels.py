"""Cylindrical voxels of a scan: sectors of azimuth, rings of range, layers of height.

Source: EgoNN (Komorowski et al., RA-L 2021, Sec. III-A) and its repository jac99/Egonn.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.core.arrays import real_array
from deepring.errors import ConfigError, DataError
from deepring.rasters.base import Raster
from deepring.rasters.downsample import spread
from deepring.rasters.points import within
from deepring.rasters.preprocessing import Preprocessing

PADDING = int(np.iinfo(np.int16).min)
"""Value of the rows after the last voxel; no index is this low."""


@dataclass(frozen=True)
class VoxelRaster(Raster, kind="voxels"):
    """Occupied cylindrical voxels (θ, r, z), padded to ``max_voxels`` rows: int16.

    Indices and order are those of `cylindrical_voxels` for points less than ``radius`` metres
    away, followed by rows of `PADDING`. Of more than ``max_voxels`` voxels, evenly spread ones in
    that order remain, so that every direction loses the same share.

    >>> VoxelRaster(max_voxels=100).shape
    (100, 3)
    """

    max_voxels: int = 16384
    degrees: float = 1.0  # of a voxel along θ
    ring: float = 0.3  # metres along r
    height: float = 0.2  # metres
    radius: float = 70.0  # metres
    preprocessing: Preprocessing = field(default_factory=Preprocessing)

    axes = ("voxel", "theta_r_z")
    dtype = np.dtype(np.int16)

    def __post_init__(self) -> None:
        self.check_counts("max_voxels")
        self.check_lengths("ring", "height", "radius")
        self.check_reach(self.radius)
        sectors_of(self.degrees)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of voxels, and 3 for θ, r, z."""
        return (self.max_voxels, 3)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.int16]:
        """Indices of the occupied voxels, then padding, (max_voxels, 3) int16."""
        near = within(points, self.radius)
        voxels = cylindrical_voxels(near, self.degrees, self.ring, self.height)
        if len(voxels) > self.max_voxels:
            voxels = voxels[spread(len(voxels), self.max_voxels)]
        rows = np.full(self.shape, PADDING, dtype=np.int16)
        rows[: len(voxels)] = voxels
        return rows

    def is_blank(self, image: NDArray[Any]) -> bool:
        """Whether no voxel is occupied."""
        return bool((image == PADDING).all())

    @property
    def sectors(self) -> int:
        """Sectors of azimuth in a full turn."""
        return sectors_of(self.degrees)

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Voxels (n, max_voxels, 3) turned by ``sectors`` (n,), counter-clockwise.

        The rows are not sorted again; networks sort them.
        """
        theta = images[..., 0].long()
        angles = (theta + sectors[:, None]) % self.sectors
        theta = torch.where(theta == PADDING, theta, angles).to(images.dtype)
        return torch.cat([theta[..., None], images[..., 1:]], dim=-1)


def sectors_of(degrees: float) -> int:
    """Number of sectors per turn. Raises ConfigError unless ``degrees`` divides 360.

    >>> sectors_of(0.5)
    720
    """
    sectors = round(360 / degrees) if 0 < degrees <= 360 else 0
    if not 0 < sectors < -PADDING or abs(sectors * degrees - 360) > 1e-6:
        raise ConfigError(f"voxels.degrees: {degrees!r}, expected a step that divides 360")
    return sectors


def cylindrical_voxels(
    points: NDArray[np.float32],
    degrees: float = 1.0,
    ring: float = 0.3,
    height: float = 0.2,
) -> NDArray[np.int16]:
    """Occupied voxels (θ, r, z) of a scan, (m, 3) int16, unique and in lexicographic order.

    Sector 0 begins at azimuth -π, behind the sensor, and sectors count counter-clockwise, as in
    EgoNN's code, where azimuth +π has its own sector; here it falls into sector 0. The order of
    the points does not matter. A scan without points has no voxels.

    Args:
        points: (n, 3) float32, metres.
        degrees: width of a sector; divides 360.
        ring: depth of a ring, metres.
        height: height of a layer, metres; layer 0 begins at z = 0.

    Raises:
        ConfigError: an invalid step.
        DataError: no points (n, >=3), a coordinate that is not finite, or an index beyond int16.

    >>> points = np.array([[10.0, 0.1, 1.0], [10.0, 0.2, 1.1]], dtype=np.float32)
    >>> cylindrical_voxels(points, degrees=90.0, ring=3.0, height=1.0)
    array([[2, 3, 1]], dtype=int16)
    """
    sectors = sectors_of(degrees)
    checks.positive("voxels.ring", ring, "metres")
    checks.positive("voxels.height", height, "metres")
    rows = real_array("points", points)
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise DataError(f"points: shape {rows.shape}, expected (n, 3)")
    x, y, z = rows[:, :3].astype(np.float64).T
    cells = np.stack([(np.degrees(np.arctan2(y, x)) + 180) / degrees, np.hypot(x, y) / ring, z])
    cells[2] /= height
    if cells.size == 0:
        return np.empty((0, 3), dtype=np.int16)
    # Written so that NaN fails too.
    if not np.abs(cells).max() < -PADDING:
        raise DataError(
            f"points: {cells.shape[1]} points with a coordinate that is not finite or with a voxel "
            f"index of {-PADDING} or more; expected finite metres and larger steps"
        )
    index = np.floor(cells).astype(np.int64)
    index[0] %= sectors
    # One number per voxel sorts much faster than rows of three.
    low = index.min(axis=1)
    extent = index.max(axis=1) - low + 1
    keys = np.unique(np.ravel_multi_index(tuple(index - low[:, None]), tuple(extent)))
    return (np.stack(np.unravel_index(keys, tuple(extent)), axis=1) + low).astype(np.int16)

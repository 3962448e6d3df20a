"""Points of a scan, one for each occupied voxel, which can be moved: LCDNet's input."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deepring import checks
from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.downsample import spread
from deepring.rasters.preprocessing import Preprocessing

#: Value of the rows without a point; no coordinate is this low.
NO_POINT = int(np.iinfo(np.int16).min)

#: Largest coordinate as it is stored, which stands for the radius, and the largest intensity.
FULL = int(np.iinfo(np.int16).max)

#: Steps of a metre in which coordinates are added, so that their order does not matter.
_EXACT = 2.0**20


def published() -> Preprocessing:
    """LCDNet's crop: 3 m below to 1 m above a sensor at KITTI's height, with the ground."""
    return Preprocessing(height=(-1.27, 2.73), clearance=None, extent=70.4)


@dataclass(frozen=True)
class VoxelMeansRaster(Raster, kind="voxel_means"):
    """The mean point of each occupied voxel: (max_points, 4) int16 of x, y, z and intensity.

    The first ``keypoints`` rows are the farthest-point sample of the means, beginning with the one
    farthest from the sensor; the others follow by x, y, z of their voxels, and rows of `NO_POINT`
    after these. Of more than ``max_points`` voxels, evenly spread ones remain.

    Coordinates are in units of ``radius`` / 32767, 2 mm, intensities in units of 1 / 32767. All
    have an intensity of 1 here, so that any scan serves; `IntensityMeansRaster` reads it. Voxels
    are cubes of ``size`` metres and begin at -radius in x and y, and at the lower end of the
    preprocessing's ``height``.

    LCDNet takes the mean of up to 5 points in each voxel, in the order of the scan, and samples
    its keypoints from all points; here all points of a voxel count, and the means are sampled.

    >>> points = np.array([[5.01, 0.02, 1.0], [5.03, 0.02, 1.0]])
    >>> image = VoxelMeansRaster(max_points=2, keypoints=1)(points, ground_z=0.0)
    >>> (image[0] / 32767 * [70.4, 70.4, 70.4, 1]).round(2).tolist(), image[1].tolist()
    ([5.02, 0.02, 1.0, 1.0], [-32768, 0, 0, 0])
    """

    max_points: int = 40000
    keypoints: int = 4096
    size: float = 0.1
    radius: float = 70.4  # metres; half of the square's side
    preprocessing: Preprocessing = field(default_factory=published)

    axes = ("point", "xyzi")
    dtype = np.dtype(np.int16)

    def __post_init__(self) -> None:
        checks.count("raster.keypoints", self.keypoints)
        checks.count("raster.max_points", self.max_points, self.keypoints, 2**20)
        self.check_lengths("size", "radius")
        self.check_reach(self.radius)
        low, high = self.preprocessing.height
        if max(-low, high) > self.radius:
            raise ConfigError(
                f"preprocessing.height: {[low, high]}, expected heights within ±{self.radius:g} m, "
                "the raster.radius by which the VoxelMeansRaster scales coordinates"
            )
        if math.prod(self.extent) > 2**40 or max(self.extent) > 2**15:
            raise ConfigError(
                f"raster.size: {self.size:g} m, expected larger voxels of a scan of "
                f"{2 * self.radius:g} m"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of points, and 4 for x, y, z, intensity."""
        return (self.max_points, 4)

    @property
    def extent(self) -> tuple[int, int, int]:
        """Voxels along x, y and z."""
        low, high = self.preprocessing.height
        across, up = (
            math.ceil(length / self.size - 1e-6) for length in (2 * self.radius, high - low)
        )
        return across, across, up

    @property
    def corner(self) -> tuple[float, float, float]:
        """Where the voxels begin, metres."""
        return -self.radius, -self.radius, self.preprocessing.height[0]

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.int16]:
        """Means of points (n, 3 + columns), (max_points, 4) int16."""
        means = self._means(np.column_stack([points[:, :3], self.intensities(points)]))
        if len(means) > self.max_points:
            means = means[spread(len(means), self.max_points)]
        rows = np.zeros(self.shape, dtype=np.int16)
        rows[:, 0] = NO_POINT
        rows[: len(means)] = self._stored(means)[self._order(means)]
        return rows

    def intensities(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Of points (n, 3 + columns), (n,) in [0, 1]: 1."""
        return np.ones(len(points), dtype=np.float32)

    def _means(self, values: NDArray[np.float32]) -> NDArray[np.float64]:
        """x, y, z and intensity (m, 4) of each occupied voxel, by x, then y, then z."""
        cells = np.floor((values[:, :3] - self.corner) / self.size).astype(np.int64)
        inside = ((cells >= 0) & (cells < self.extent)).all(axis=1)
        values, cells = values[inside], cells[inside]
        keys = np.ravel_multi_index(tuple(cells.T), self.extent)
        _, voxel, counts = np.unique(keys, return_inverse=True, return_counts=True)
        sums = [np.bincount(voxel, np.rint(column * _EXACT)) for column in values.T]
        means: NDArray[np.float64] = np.stack(sums, axis=1) / (counts[:, None] * _EXACT)
        return means

    def _stored(self, means: NDArray[np.float64]) -> NDArray[np.int16]:
        scale = FULL / np.array([self.radius, self.radius, self.radius, 1.0])
        return np.rint(means * scale).astype(np.int16)

    def _order(self, means: NDArray[np.float64]) -> NDArray[np.int64]:
        """Numbers of all means, the keypoints first."""
        from deepring.rasters import _farthest_kernels as _kernels

        if not len(means):
            return np.zeros(0, dtype=np.int64)
        x, y, z = np.ascontiguousarray(means[:, :3].T, dtype=np.float32)
        chosen = np.empty(min(self.keypoints, len(means)), dtype=np.int64)
        _kernels.farthest(x, y, z, int(np.hypot(x, y).argmax()), chosen)
        rest = np.ones(len(means), dtype=np.bool_)
        rest[chosen] = False
        return np.concatenate([chosen, np.flatnonzero(rest)])

    def is_blank(self, image: NDArray[Any]) -> bool:
        """Whether there is no point."""
        return bool((image[:, 0] == NO_POINT).all())

    def in_metres(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """x, y, z and intensity (n, max_points, 4) float32 of images, and which rows hold a point.

        The first three are metres, the last is in [0, 1]; both are 0 where there is none.
        """
        filled = images[..., 0] != NO_POINT
        scale = torch.tensor([self.radius] * 3 + [1.0], device=images.device) / FULL
        return images.float() * scale * filled[..., None], filled

    @property
    def sectors(self) -> int:
        """360: points can be turned by any angle, and whole degrees suffice."""
        return 360

    def turned(self, images: Tensor, sectors: Tensor) -> Tensor:
        """Points (n, max_points, 4) turned about z by ``sectors`` (n,) degrees, see `moved`."""
        turn = torch.deg2rad(sectors.double())
        transforms = torch.eye(4, dtype=torch.float64).repeat(len(images), 1, 1)
        transforms[:, 0, 0] = transforms[:, 1, 1] = turn.cos()
        transforms[:, 1, 0] = turn.sin()
        transforms[:, 0, 1] = -turn.sin()
        return self.moved(images, transforms)

    def moved(self, images: Tensor, transforms: Tensor) -> Tensor:
        """The points of images (n, max_points, 4) moved by rigid transforms (n, 4, 4).

        Points that leave the box are lost, and the rows behind them move up: the first ones are
        still far apart. What is in one voxel may lie in two afterwards, and the other way round.
        """
        points, filled = self.in_metres(images)
        transforms = transforms.to(points)
        xyz = points[..., :3] @ transforms[:, :3, :3].transpose(1, 2) + transforms[:, None, :3, 3]
        low = xyz.new_tensor(self.corner)
        high = xyz.new_tensor([self.radius, self.radius, self.preprocessing.height[1]])
        filled = filled & ((xyz >= low) & (xyz < high)).all(dim=-1)
        moved = torch.cat([(xyz * (FULL / self.radius)).round(), images[..., 3:].float()], dim=-1)
        gone = moved.new_tensor([NO_POINT, 0, 0, 0])
        moved = torch.where(filled[..., None], moved, gone).to(images.dtype)
        order = (~filled).sort(dim=1, stable=True).indices
        return moved.gather(1, order[..., None].expand_as(moved))


@dataclass(frozen=True)
class IntensityMeansRaster(VoxelMeansRaster, kind="intensity_means"):
    """The same with the mean intensity of the points in each voxel.

    Intensities are divided by ``full_intensity``, which is 1 for KITTI and 255 for NCLT, and cut
    at 0 and 1.

    >>> points = np.array([[5.01, 0.02, 1.0, 0.2], [5.03, 0.02, 1.0, 1.5]])
    >>> image = IntensityMeansRaster(max_points=2, keypoints=1)(points, ground_z=0.0)
    >>> (image[0] / 32767 * [70.4, 70.4, 70.4, 1]).round(2).tolist()
    [5.02, 0.02, 1.0, 0.6]
    """

    full_intensity: float = 1.0

    columns = ("intensity",)

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.positive("raster.full_intensity", self.full_intensity)

    def intensities(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Of points (n, 4), (n,) in [0, 1]."""
        shares: NDArray[np.float32] = np.clip(points[:, 3] / np.float32(self.full_intensity), 0, 1)
        return shares

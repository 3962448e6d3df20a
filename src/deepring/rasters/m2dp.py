"""M2DP: a scan projected onto many planes, and what they have most in common (He et al. 2016).

L. He, X. Wang, H. Zhang: M2DP: A novel 3D point cloud descriptor and its application in loop
closure detection, IROS 2016. The descriptor depends on the points alone, so that it is computed
once per scan and kept as a raster.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.errors import ConfigError
from deepring.rasters.base import Raster
from deepring.rasters.downsample import voxel_means
from deepring.rasters.highest import check_grid, whole_scan
from deepring.rasters.preprocessing import Preprocessing, finite_coordinates

#: Eigenvalues that differ by less than this share of the largest leave their axes open.
_EQUAL = 1e-9

#: Signs of the first and second axis. The third keeps its own: it is upright in a scan that is
#: wider than tall.
_FLIPS = ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))


@dataclass(frozen=True)
class M2dpRaster(Raster, kind="m2dp"):
    """M2DP's descriptor: (signs, planes + bins) float32; zeros for points without own axes.

    Args:
        azimuths, elevations: numbers of directions of the planes' normals.
        radial, angular: bins of a plane.
        grid: side of the cubes, metres, whose points are averaged first; None takes all points,
            as the authors' code does.
        signs: 1, the published descriptor, or 4: also those of the scan with its first and second
            axis negated, ours.

    >>> M2dpRaster().shape
    (1, 192)
    """

    azimuths: int = 4
    elevations: int = 16
    radial: int = 8
    angular: int = 16
    grid: float | None = None
    signs: int = 1
    preprocessing: Preprocessing = field(default_factory=whole_scan)

    axes = ("sign", "value")
    dtype = np.dtype(np.float32)

    def __post_init__(self) -> None:
        self.check_counts("azimuths", "elevations", "radial", "angular")
        check_grid(self.grid)
        if self.signs not in (1, len(_FLIPS)):
            raise ConfigError(f"raster.signs: {self.signs!r}, expected 1 or {len(_FLIPS)}")

    @property
    def shape(self) -> tuple[int, int]:
        """Signs, and planes and bins together."""
        return (self.signs, self.azimuths * self.elevations + self.radial * self.angular)

    def rasterize(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Descriptors of the scan with each choice of signs."""
        points = finite_coordinates(points).reshape(-1, 3)
        grid = self.grid if len(points) else None
        own = in_own_axes(points if grid is None else voxel_means(points, grid))
        if own is None:
            return np.zeros(self.shape, dtype=np.float32)
        planes = m2dp_planes(self.azimuths, self.elevations)
        descriptors = [
            m2dp(own * np.array([*flip, 1.0]), planes, self.radial, self.angular)
            for flip in _FLIPS[: self.signs]
        ]
        return np.stack(descriptors).astype(np.float32)


class Planes(NamedTuple):
    """The two axes of each plane, at right angles and of one length, at most 1."""

    along: NDArray[np.float64]
    """(planes, 3): the first axis of the scan, as it lies in the plane."""
    across: NDArray[np.float64]
    """(planes, 3): the plane's normal times ``along``."""


def in_own_axes(points: NDArray[np.floating]) -> NDArray[np.float64] | None:
    """Points (n, 3) from their mean, in the axes of their covariance, by falling variance.

    An axis points where its largest coordinate in the scan's frame is positive, as MATLAB's `pca`
    has it and the authors rely on: a turned scan may come out with an axis negated. None for less
    than three points and where two variances are equal, so that their axes are open.

    >>> points = np.array([[-4.0, 0, 0], [4, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 0]])
    >>> turned = points[:, [1, 0, 2]]
    >>> bool(np.array_equal(in_own_axes(points), in_own_axes(turned)))
    True
    """
    if len(points) < 3:
        return None
    centred = points.astype(np.float64)
    centred -= centred.mean(axis=0)
    variances, axes = np.linalg.eigh(centred.T @ centred / len(centred))
    if np.diff(variances).min() <= _EQUAL * variances[-1]:
        return None
    axes = axes[:, ::-1]
    largest = axes[np.abs(axes).argmax(axis=0), range(3)]
    return centred @ (axes * np.sign(largest))


def m2dp_planes(azimuths: int = 4, elevations: int = 16) -> Planes:
    """The planes of each azimuth of the normal over [-π/2, π/2], and elevation over [0, π/2].

    Elevations follow each other; those of 90° are the same plane for each azimuth.
    """
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi / 2, np.pi / 2, azimuths),
        np.linspace(0, np.pi / 2, elevations),
        indexing="ij",
    )
    normal = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    ).reshape(-1, 3)
    along = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal  # not normalised, as published
    return Planes(along, np.cross(normal, along))


def plane_shares(
    own: NDArray[np.float64], planes: Planes, radial: int = 8, angular: int = 16
) -> NDArray[np.float64]:
    """The share of the points (n, 3) in each bin of each plane, (planes, radial x angular).

    Rings end at (k √R / radial)², R the largest distance of a point from the origin; sectors
    divide [-π, π]. The last bins are closed.
    """
    from deepring.rasters import _m2dp_kernels as _kernels

    counts = np.zeros((len(planes.along), radial, angular), dtype=np.int64)
    farthest = float(np.sqrt((own**2).sum(axis=1).max()))
    _kernels.plane_counts(
        np.ascontiguousarray(own), planes.along, planes.across, farthest, angular, counts
    )
    shares: NDArray[np.float64] = counts.reshape(len(counts), -1) / len(own)
    return shares


def m2dp(
    own: NDArray[np.float64], planes: Planes, radial: int = 8, angular: int = 16
) -> NDArray[np.float64]:
    """The first left and right singular vectors of `plane_shares`, one after the other.

    A matrix without negative numbers has first singular vectors whose entries are all of one sign
    (Perron and Frobenius): the positive ones are taken.
    """
    left, _, right = np.linalg.svd(plane_shares(own, planes, radial, angular), full_matrices=False)
    return np.abs(np.concatenate([left[:, 0], right[0]]))

"""What a sensor would see of a cloud from a place: points without those that others hide."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deepring import checks
from deepring.data.clouds.tiles import TiledCloud
from deepring.data.session import Points
from deepring.errors import ConfigError

#: Degrees between the lowest and the highest elevation. The narrowest sensors see 20 and more, and
#: all numbers in radians lie within 3.2.
LEAST_FOV = 4.0


@dataclass(frozen=True)
class VirtualSensor:
    """The sensor with which scans are going to be located, and how hidden points are told.

    Points are sorted into bins of azimuth and elevation. A point hides what is more than ``behind``
    metres behind it, in its own bin and in those that it covers as a ball of the size of the
    cloud's gaps, so that a near wall has no holes.
    """

    height: float = 1.73
    """Metres above the ground. A car's roof; 0.5 m more or less changes little."""
    fov: tuple[float, float] = (-25.0, 20.0)
    """Lowest and highest elevation, degrees. More than most sensors see upwards: a cloud fused of
    scans from all along a road shows the tops of what each scan saw from afar."""
    reach: float = 70.0
    """Metres along the ground."""
    azimuth_bin: float = 1.0
    """Degrees, rounded so that they fill the circle."""
    elevation_bin: float = 0.8
    """Degrees."""
    most_bins: int = 6
    """Along each axis that one point covers."""
    behind: float = 1.0
    """Metres."""

    def __post_init__(self) -> None:
        checks.between("height", self.height, 0.1, 100, "metres")
        low, high = checks.interval("fov", self.fov, "degrees")
        if low < -90 or high > 90:
            raise ConfigError(f"fov: {low:g} to {high:g}, expected degrees from -90 to 90")
        if high - low < LEAST_FOV:
            raise ConfigError(
                f"fov: {low:g} to {high:g}, expected at least {LEAST_FOV:g} degrees between them; "
                "radians are not taken"
            )
        for name in ("reach", "azimuth_bin", "elevation_bin", "behind"):
            checks.positive(f"sensor.{name}", getattr(self, name))
        checks.count("sensor.most_bins", self.most_bins)

    @property
    def shape(self) -> tuple[int, int]:
        """Bins of elevation and of azimuth."""
        low, high = self.fov
        rows = max(1, math.ceil((high - low) / self.elevation_bin - 1e-9))
        return rows, max(1, round(360 / self.azimuth_bin))


def virtual_scan(
    cloud: TiledCloud, position: ArrayLike, size: float, sensor: VirtualSensor
) -> Points:
    """The points (n, 3) float32 that a sensor sees, metres from it, axes as the cloud's.

    Args:
        cloud: the points around.
        position: (3,) of the sensor, metres in the cloud's coordinates.
        size: of a point, metres: the gaps of the cloud that are no gaps of a surface.
        sensor: its field of view.
    """
    from deepring.localization.clouds import _visibility_kernels as kernels

    position = np.asarray(position, dtype=np.float64)
    depth = np.full(sensor.shape, np.inf)
    low = math.radians(sensor.fov[0])
    step = np.array([np.radians(sensor.elevation_bin), 2 * np.pi / sensor.shape[1]])
    # The cloud is passed through twice: the depth has to be known before the first point is kept.
    parts: list[tuple[Any, ...]] = []
    for corner, points in cloud.parts(position[:2] - sensor.reach, position[:2] + sensor.reach):
        shift = position - corner
        cells, ranges = np.empty(len(points), dtype=np.int32), np.empty(len(points))
        kernels.bins_of(points, shift, sensor.reach, low, step, depth, cells, ranges)
        kernels.lower_depth(cells, ranges, size, sensor.most_bins, step, low, depth)
        parts.append((points, shift, cells, ranges))
    total = sum(len(points) for points, *_ in parts)
    seen: NDArray[np.float32] = np.empty((total, 3), dtype=np.float32)
    count = 0
    for part in parts:
        count = kernels.seen(*part, depth, sensor.behind, seen, count)
    return seen[:count].copy()

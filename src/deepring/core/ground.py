"""Crop and ground removal: from a raw scan to the points that tell places apart."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from deepring.errors import DeepringError


@dataclass(frozen=True)
class Preprocessing:
    """What is kept of a scan. Heights are metres above the nominal ground under the sensor.

    ``height`` is the kept band. ``clearance`` is the height above the local ground below which
    points are dropped, local ground being the lowest point within ``window`` x ``window`` cells
    of ``cell`` metres; None trusts the band alone, as RING's published code does (1 to 20 m).
    The local minimum holds where the platform tilts: at 3° a flat floor rises 3.7 m over 70 m.
    """

    height: tuple[float, float] = (-5.0, 20.0)
    clearance: float | None = 0.5
    window: int = 5
    cell: float = 140.0 / 120
    extent: float = 70.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "height", tuple(self.height))
        low, high = self.height
        if not low < high:
            raise DeepringError(
                f"preprocessing.height: {[low, high]}, expected [low, high] with low < high"
            )
        for name in ("window", "cell", "extent"):
            if getattr(self, name) <= 0:
                raise DeepringError(
                    f"preprocessing.{name}: {getattr(self, name)}, expected more than 0"
                )

    def __call__(self, points: NDArray[np.float32], ground_z: float) -> NDArray[np.float32]:
        """Kept points (m, 3) with z above the nominal ground, of (n, 3) in the scan's frame.

        ``ground_z`` is the z of the ground under the sensor in the scan's frame (metres).
        """
        low, high = self.height
        z = points[:, 2]
        near = np.abs(points[:, :2]).max(axis=1, initial=0.0) < self.extent
        band = points[near & (z > low + ground_z) & (z < high + ground_z)]
        if self.clearance is not None:
            band = band[self._stands(band)]
        band[:, 2] -= np.float32(ground_z)
        return band

    def _stands(self, points: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which points stand more than the clearance above the local ground."""
        from deepring.core import _kernels

        cells = max(1, round(2 * self.extent / self.cell))
        lowest = np.full((cells, cells), np.inf, dtype=np.float32)
        points = np.ascontiguousarray(points)
        _kernels.lowest_point(points, self.extent, cells, lowest)
        floor = minimum_filter(lowest, size=self.window, mode="nearest")
        keep = np.empty(len(points), dtype=np.bool_)
        _kernels.above_floor(points, self.extent, cells, floor, self.clearance, keep)
        return keep

"""The ground, whose height is a sum of plane sine waves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ground:
    """z = Σ amplitude · sin(kx x + ky y + phase). Each array is (waves,), metres and radians."""

    kx: FloatArray
    ky: FloatArray
    amplitude: FloatArray
    phase: FloatArray

    def height(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Height (metres) at world coordinates ``x``, ``y`` of equal shape."""
        z = np.zeros(np.shape(x))
        for kx, ky, a, p in zip(self.kx, self.ky, self.amplitude, self.phase, strict=True):
            z += a * np.sin(kx * x + ky * y + p)
        return z


def rolling_ground(relief: float, rng: np.random.Generator) -> Ground:
    """Six waves of 90 to 400 m whose sum has the standard deviation ``relief`` (metres)."""
    length = np.geomspace(90.0, 400.0, 6)
    weight = length / np.sqrt(np.sum(length**2))  # longer waves are higher: slopes stay gentle
    direction = rng.uniform(0.0, 2 * np.pi, 6)
    k = 2 * np.pi / length
    return Ground(
        kx=k * np.cos(direction),
        ky=k * np.sin(direction),
        amplitude=relief * np.sqrt(2.0) * weight,
        phase=rng.uniform(0.0, 2 * np.pi, 6),
    )

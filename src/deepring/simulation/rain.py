"""What drops of rain do to rays: some return an echo, some take the ray away."""

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.fan import Fan
from deepring.simulation.raycast import NOTHING

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Hit of a drop, beside the hits of `cast`.
DROP = -3

_ECHO_RANGE = 8.0  # metres; a drop at this distance returns an echo in 1 / e of the cases


def extinction(mm_per_hour: float) -> float:
    """Share of the power that rain takes per metre: 1.076 R^0.67 dB/km (ITU-R P.1817, rain)."""
    decibels = 1.076 * mm_per_hour**0.67 / 1000.0
    return float(decibels * np.log(10.0) / 10.0)


def through_rain(
    fan: Fan,
    distance: FloatArray,
    hit: IntArray,
    mm_per_hour: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, IntArray]:
    """Horizontal distances (C, B) and hits (C, B) of `cast`, as they are in rain.

    Each ray meets its first drop after a random length, on the way out or back. If this is in
    front of the surface and near, the drop itself may be measured (DROP); otherwise the ray is
    lost.
    """
    slant = np.sqrt(1 + fan.slopes**2)
    free = rng.exponential(1 / extinction(mm_per_hour), hit.shape)
    echo = rng.random(hit.shape) < np.exp(-free / _ECHO_RANGE)
    reach = distance * slant
    drop = (free < reach) & echo
    lost = (free < 2 * reach) & ~drop
    distance = np.where(drop, free / slant, np.where(lost, np.inf, distance))
    return distance, np.where(drop, DROP, np.where(lost, NOTHING, hit))

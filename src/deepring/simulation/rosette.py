"""The non-repetitive pattern of a scanner with two rotating prisms."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Revolutions per second of the prisms of a Livox Mid-40, 7294 and -4664 per minute (Liu, Yuan,
#: Zhang: Low-cost Retina-like Robotic Lidars Based on Incommensurable Scanning, 2021).
_PRISMS = (7294 / 60, -4664 / 60)


@dataclass(frozen=True)
class Rosette:
    """A field of view of ``width`` x ``height`` degrees, with ``points`` shots per sweep.

    ``lasers`` fire in turn, ``spread`` degrees from the lowest to the highest of them.
    Each prism bends the ray by the same angle, so that their sum runs through a disc in petals,
    which is stretched to an ellipse of width and height. The prisms' angles at the start of a
    sweep are independent of the sweep before: in the seconds between two scans of a drive they
    turn hundreds of times.
    """

    width: float
    height: float
    points: int
    lasers: int
    spread: float

    def shots(self, seconds: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Azimuths and elevations (points,) of a sweep of ``seconds``, in firing order (rad)."""
        time = np.linspace(0.0, seconds, self.points, endpoint=False)
        one, other = (2 * np.pi * (rate * time + rng.random()) for rate in _PRISMS)
        width, height = np.deg2rad([self.width / 2, (self.height - self.spread) / 2])
        lasers = np.deg2rad(np.linspace(-self.spread / 2, self.spread / 2, self.lasers))
        azimuth: FloatArray = width * (np.cos(one) + np.cos(other)) / 2
        elevation: FloatArray = height * (np.sin(one) + np.sin(other)) / 2
        return azimuth, elevation + lasers[np.arange(self.points) % self.lasers]

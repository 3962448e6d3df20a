"""The rays of a sweep: vertical columns of beams, in equal steps around the sensor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fan:
    """Rays in columns: C azimuths in equal counter-clockwise steps, B beams each.

    ``first`` is the world heading (rad) of column 0. ``slopes`` (C, B) are the tangents of the
    beams' world elevations, ascending along B. ``circle`` is the number of columns that would go
    round; None: these do.
    """

    first: float
    slopes: FloatArray
    circle: int | None = None

    @property
    def headings(self) -> FloatArray:
        """World heading (C,) of each column (rad)."""
        return self.first + self.step * np.arange(len(self.slopes), dtype=np.float64)

    @property
    def step(self) -> float:
        """Angle between neighbouring columns (rad)."""
        return 2 * np.pi / self.around

    @property
    def around(self) -> int:
        """Number of columns that go round."""
        return self.circle or len(self.slopes)

    @property
    def whole(self) -> bool:
        """Whether the columns go round."""
        return self.around == len(self.slopes)

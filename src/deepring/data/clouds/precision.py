"""Whether a file's coordinates are precise enough to be a map's."""

import numpy as np
from numpy.typing import NDArray

from deepring.errors import DataError

#: Metres between neighbouring numbers of single precision, from which points lie on a raster that
#: one can see: from 2^20, 1048576 m, they are 0.125 m apart.
COARSE = 0.1
_LARGE = float(2**20)
#: Share of points so far away that are strays and not the cloud.
_STRAYS = 0.01


class PrecisionCheck:
    """Counts points in single precision whose coordinates are too large for it.

    UTM's northings are such: 4 037 000 m in single precision is on a raster of 0.25 m.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._points = self._coarse = 0
        self._largest = 0.0

    def add(self, points: NDArray[np.float64]) -> None:
        """Count points (n, 3), finite."""
        size = np.abs(points).max(axis=1, initial=0.0)
        self._points += len(points)
        self._coarse += int((size >= _LARGE).sum())
        self._largest = max(self._largest, float(size.max(initial=0.0)))

    def expect_enough(self) -> None:
        """Raise DataError where more than a few points are too coarse."""
        if self._coarse > _STRAYS * self._points:
            step = float(np.spacing(np.float32(self._largest)))
            raise DataError(
                f"cloud {self.source}: coordinates up to {self._largest:.0f} m in single precision "
                f"(float32), which has steps of {step:g} m there; expected at most {COARSE:g} m: "
                "subtract an origin before the cloud is written, or write it in double precision"
            )

"""Where to train and where to test in a simulated world, in the ground truth's coordinates.

Every world is split along its x axis: crossings of the train part lie at x <= 0, those of the
test part at x >= GAP. No place of one region sees a place of the other within the 70 m that the
descriptors look at. The street that joins the parts crosses the gap and belongs to neither.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Width of the strip along x between the two regions (metres).
GAP = 150.0

#: UTM zone 52N easting and northing of the simulated city's origin (metres).
UTM_ORIGIN = (345000.0, 4037000.0)


@dataclass(frozen=True)
class Box:
    """An axis-parallel rectangle of planar coordinates (metres), edges included."""

    low: tuple[float, float]
    high: tuple[float, float]

    def contains(self, positions: ArrayLike) -> NDArray[np.bool_]:
        """Whether positions (n, 2) lie inside: (n,) bool."""
        p = np.asarray(positions, dtype=np.float64)
        inside: NDArray[np.bool_] = np.all((p >= self.low) & (p <= self.high), axis=-1)
        return inside


#: North, east as NCLT's ground truth writes them; large enough for worlds of any preset.
NCLT_TRAIN = Box((-2000.0, -2000.0), (0.0, 2000.0))
NCLT_TEST = Box((GAP, -2000.0), (GAP + 2000.0, 2000.0))

#: Easting, northing as MulRan's ground truth writes them.
MULRAN_TRAIN = Box((343000.0, 4035000.0), (345000.0, 4039000.0))
MULRAN_TEST = Box((345000.0 + GAP, 4035000.0), (347000.0 + GAP, 4039000.0))

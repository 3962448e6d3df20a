"""How a scan lies on a place."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.core.rigid import yaw_of


class Lie(NamedTuple):
    """How the query lies on a place."""

    turn: float
    """Radians, the turn of the points from place to query."""
    position: tuple[float, float] | None
    """Metres, of the query's sensor in the place's frame; None where only the turn is known."""


def lie_of(pose: NDArray[np.float64]) -> Lie:
    """How a query lies whose frame has this pose (4, 4) in the place's."""
    return Lie(-float(yaw_of(pose)), (float(pose[0, 3]), float(pose[1, 3])))

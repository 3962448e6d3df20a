"""What the ground is made of: roads, parking, sidewalks, and terrain behind them.

It follows from the streets and the parked cars of a world, without a random number of its own.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.measures import SIDEWALK
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import PointClass, Prisms
from deepring.simulation.streets import Streets, clearance

FloatArray = NDArray[np.float64]

_SLOT = (0.6, 0.35)  # of a parking slot beyond the car in it, along and across (metres)
_NEAREST = 4  # slots that overlap at one point
_ON_A_DECK = 1.0  # cars that stand so much above the ground park on no ground (metres)


@dataclass(frozen=True, eq=False)
class GroundCover:
    """Road within ``kerb`` metres of a street's middle, then ``sidewalk`` metres, then terrain.

    Slots in which a car is parked in either session are parking, but for those in the road.
    """

    streets: Streets
    parked: Prisms
    kerb: float
    sidewalk: float

    def kinds(self, points: FloatArray) -> NDArray[np.uint16]:
        """The `PointClass` of the ground at world points (n, 2): (n,)."""
        kinds = np.full(len(points), PointClass.TERRAIN, np.uint16)
        if len(points):
            away = clearance(points, self.streets, self.kerb + self.sidewalk)
            kinds[away < self.kerb + self.sidewalk] = PointClass.SIDEWALK
            kinds[self._in_a_slot(points)] = PointClass.PARKING
            kinds[away < self.kerb] = PointClass.ROAD
        return kinds

    def _in_a_slot(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which points (n, 2) are in the slot of a parked car: (n,)."""
        inside = np.zeros(len(points), np.bool_)
        cars, (along, across) = self.parked, _SLOT
        if not len(cars):
            return inside
        reach = float(np.hypot(cars.half_length + along, cars.half_width + across).max())
        nearest = range(1, min(_NEAREST, len(cars)) + 1)
        away, car = self._tree.query(points, k=list(nearest), distance_upper_bound=reach)
        point, rank = np.nonzero(np.isfinite(away))
        car = car[point, rank]
        dx, dy = points[point, 0] - cars.x[car], points[point, 1] - cars.y[car]
        c, s = np.cos(cars.yaw[car]), np.sin(cars.yaw[car])
        hit = np.abs(c * dx + s * dy) < cars.half_length[car] + along
        hit &= np.abs(c * dy - s * dx) < cars.half_width[car] + across
        inside[point[hit]] = True
        return inside

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(np.column_stack([self.parked.x, self.parked.y]))


def ground_cover(
    streets: Streets, prisms: Prisms, heights: FloatArray, settings: SimulationSettings
) -> GroundCover:
    """The cover of a world of ``prisms``, above ground of the ``heights`` (n,) under each."""
    parked = (prisms.kind == PointClass.PARKED_CAR) & (prisms.z0 < heights + _ON_A_DECK)
    cars = prisms[np.flatnonzero(parked)]
    return GroundCover(streets, cars, settings.corridor, SIDEWALK[settings.world])

"""A world: streets, ground, standing objects and moving objects."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.ground import Ground, rolling_ground
from deepring.simulation.ground_cover import GroundCover, ground_cover
from deepring.simulation.kinds import (
    blocks,
    repeating,
    squares,
    terraces,
    tunnels,
    woods,
)
from deepring.simulation.measures import WorldKind
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import DATABASE, PointClass, PrismList, Prisms
from deepring.simulation.streets import Streets, clearance, street_grid
from deepring.simulation.yard import Yard

FloatArray = NDArray[np.float64]

_OVERHEAD = 1.9  # what begins at least this high above the ground blocks no street (metres)
_MOVERS_AHEAD = 45.0  # largest distance of moving objects along the street (metres)


@dataclass(frozen=True, eq=False)
class World:
    """Streets, ground with its cover, and the standing prisms of both sessions (see `Prisms`)."""

    streets: Streets
    ground: Ground
    prisms: Prisms
    cover: GroundCover

    def standing(self, session: int, settings: SimulationSettings) -> Prisms:
        """The standing prisms of one session (DATABASE or QUERY), with the crowns of its season."""
        present = self.prisms[np.flatnonzero(self.prisms.sessions & session)]
        if session == DATABASE:
            return replace(present, depth=present.depth * settings.bare_season)
        return present


def build_world(settings: SimulationSettings) -> World:
    """Draw the world of ``settings``; equal settings give equal worlds."""
    rng = np.random.default_rng([settings.streets_seed, 1])
    streets = street_grid(settings, rng)
    ground = rolling_ground(settings.ground_relief, rng)
    yard = Yard(settings, ground, PrismList(), rng)
    cars = Yard(settings, ground, yard.prisms, np.random.default_rng([settings.seed, 2]))
    _FURNISH[settings.world](streets, yard, cars)
    prisms = _clear_streets(yard.prisms.freeze(), streets, ground, settings.corridor)
    heights = ground.height(prisms.x, prisms.y)
    return World(streets, ground, prisms, ground_cover(streets, prisms, heights, settings))


#: How each kind of world furnishes its streets, with yards for the world and for parked cars.
_FURNISH: dict[WorldKind, Callable[[Streets, Yard, Yard], None]] = {
    "campus": blocks.furnish,
    "city": blocks.furnish,
    "terraces": terraces.furnish,
    "squares": squares.furnish,
    "trees": woods.furnish,
    "tunnels": tunnels.furnish,
    "repeating": repeating.furnish,
}


def _clear_streets(prisms: Prisms, streets: Streets, ground: Ground, corridor: float) -> Prisms:
    """The prisms that do not stand in a street, as a corner of a building near a crossing would.

    Crowns and ceilings may hang over streets.
    """
    clear = clearance(prisms.outline(), streets).min(axis=1) >= corridor
    overhead = prisms.z0 - ground.height(prisms.x, prisms.y) > _OVERHEAD
    return prisms[np.flatnonzero(clear | overhead)]


def moving_objects(
    pose: FloatArray, ground: Ground, settings: SimulationSettings, rng: np.random.Generator
) -> Prisms:
    """Random pedestrians and vehicles in the street around the robot.

    ``pose`` (4, 4) is world <- body. All are at least 3.5 m from the robot's path.
    """
    things = Yard(settings, ground, PrismList(), rng)
    heading = float(np.arctan2(pose[1, 0], pose[0, 0]))
    width = settings.corridor + 3.0
    for _ in range(int(rng.poisson(settings.movers))):
        ahead = things.between(-_MOVERS_AHEAD, _MOVERS_AHEAD)
        aside = things.between(3.5, width) * (1.0 if things.chance(0.5) else -1.0)
        c, s = np.cos(heading), np.sin(heading)
        place = (
            float(pose[0, 3] + c * ahead - s * aside),
            float(pose[1, 3] + s * ahead + c * aside),
        )
        if things.chance(settings.mover_vehicle_share):
            tall = things.chance(0.15)
            size = (9.0, 2.5, 3.2) if tall else (things.between(3.8, 4.8), 1.8, 1.6)
            yaw = heading + things.between(-0.15, 0.15)
            things.box(place, size, yaw, PointClass.MOVING_CAR, things.between(0.2, 0.9))
        else:
            radius, height = things.between(0.22, 0.4), things.between(1.5, 1.9)
            things.post(place, radius, height, PointClass.MOVING_PERSON)
    return things.prisms.freeze()

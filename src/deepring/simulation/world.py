"""A world: streets, ground, standing objects and moving objects."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.buildings import draw_prototypes
from deepring.simulation.furnish import park_cars, place_buildings, place_structures, place_trees
from deepring.simulation.ground import Ground, rolling_ground
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import DATABASE, PointClass, PrismList, Prisms
from deepring.simulation.streets import Streets, clearance, street_grid
from deepring.simulation.yard import Yard, sides_of

FloatArray = NDArray[np.float64]

_MOVERS_AHEAD = 45.0  # largest distance of moving objects along the street (metres)


@dataclass(frozen=True, eq=False)
class World:
    """Streets, ground, and the standing prisms of both sessions (see `Prisms`)."""

    streets: Streets
    ground: Ground
    prisms: Prisms

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
    prototypes = draw_prototypes(settings, rng)
    yard = Yard(settings, ground, PrismList(), rng)
    cars = Yard(settings, ground, yard.prisms, np.random.default_rng([settings.seed, 2]))
    for street in streets.all:
        for side in sides_of(street, streets):
            character = yard.character()
            place_buildings(side, prototypes, character, yard)
            place_trees(side, character, yard)
            place_structures(side, yard)
            park_cars(side, yard, cars)
    return World(streets, ground, _clear_streets(yard.prisms.freeze(), streets, settings))


def _clear_streets(prisms: Prisms, streets: Streets, settings: SimulationSettings) -> Prisms:
    """Remove prisms that would stand in a street, e.g. a corner of a building near a crossing.

    Crowns may hang over streets.
    """
    clear = clearance(prisms.outline(), streets).min(axis=1) >= settings.corridor
    return prisms[np.flatnonzero(clear | ~prisms.grounded)]


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

"""Campus and city: copies of a few large buildings, tree rows, walls, sheds and parked cars."""

import numpy as np

from deepring.simulation.buildings import Building, draw_prototypes
from deepring.simulation.furnish import park_cars, place_structures, place_trees
from deepring.simulation.shapes import PointClass
from deepring.simulation.streets import Streets
from deepring.simulation.yard import Character, StreetSide, Yard, sides_of

_AT_CROSSING = 6.0  # buildings keep this distance from the crossing street's corridor (metres)


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Furnish both sides of every street. ``yard`` draws the world, ``cars`` the parked cars."""
    prototypes = draw_prototypes(yard.settings, yard.rng)
    for street in streets.all:
        for side in sides_of(street, streets):
            furnish_side(side, prototypes, yard, cars)


def furnish_side(side: StreetSide, prototypes: list[Building], yard: Yard, cars: Yard) -> None:
    """Furnish one side of a street, with a character of its own."""
    character = yard.character()
    place_buildings(side, prototypes, character, yard)
    place_trees(side, character, yard)
    place_structures(side, yard)
    park_cars(side, yard, cars)


def place_buildings(
    side: StreetSide, prototypes: list[Building], character: Character, yard: Yard
) -> None:
    """Place copies of the prototypes along the side, some mirrored, at varying setback."""
    corridor = yard.settings.corridor
    end = side.length - corridor - _AT_CROSSING
    position = corridor + _AT_CROSSING + yard.between(0.0, 6.0)
    while True:
        building = prototypes[int(yard.rng.integers(len(prototypes)))]
        if position + building.width > end:
            return
        setback = corridor + character.setback + yard.between(4.0, 7.0)
        if yard.chance(yard.settings.building_share * character.built):
            front = side.at(position + building.width / 2, setback)
            _place_building(side, building, front, character.height, yard)
        position += building.width + yard.between(3.0, 12.0)


def _place_building(
    side: StreetSide, building: Building, front: tuple[float, float], tall: float, yard: Yard
) -> None:
    """Copy a prototype to the plot with the middle of its front at ``front``."""
    mirror = -1.0 if yard.chance(0.5) else 1.0
    shade = yard.between(0.3, 0.7)
    plot = StreetSide(np.array(front), side.along, side.away, building.width)
    for part in (*building.walls, *building.facade):
        change = yard.settings.structures_changed if part in building.facade else 0.0
        size = (part.length, part.depth, part.height * tall)
        place = plot.at(mirror * part.along, part.away)
        yard.box(place, size, side.yaw, PointClass.BUILDING, shade, yard.session(change))

"""Streets through tunnels and under parking decks, between streets of a city."""

import numpy as np

from deepring.simulation.buildings import draw_prototypes
from deepring.simulation.kinds.blocks import furnish_side
from deepring.simulation.kinds.decks import place_deck
from deepring.simulation.shapes import PointClass
from deepring.simulation.streets import Streets
from deepring.simulation.yard import StreetSide, Yard, sides_of

_TUNNELS, _DECKS = 0.35, 0.25  # shares of the streets
_CLEAR = (4.6, 6.2)  # height of a tunnel's ceiling
_ROOF = (1.0, 3.0)  # what is on top of the ceiling
_TILE = 6.0  # length of the pieces of a ceiling, which follow the ground (metres)
_WALL = 0.6


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Furnish every street, a share of them with a tunnel or a deck over a part of its length."""
    prototypes = draw_prototypes(yard.settings, yard.rng)
    for street in streets.all:
        sides = sides_of(street, streets)
        draw = yard.rng.random()
        covered = _covered_part(sides[0], yard)
        if draw < _TUNNELS:
            place_tunnel(sides, covered, yard)
        elif draw < _TUNNELS + _DECKS:
            place_deck(sides, covered, yard, cars)
        else:
            covered = (0.0, 0.0)
        for side in sides:
            for begin, end in ((0.0, covered[0]), (covered[1], side.length)):
                if end - begin > 15.0:
                    furnish_side(side.part(begin, end), prototypes, yard, cars)


def _covered_part(side: StreetSide, yard: Yard) -> tuple[float, float]:
    """The part of a street that a tunnel or a deck covers, away from the crossings."""
    margin = yard.settings.corridor + 6.0
    room = max(side.length - 2 * margin, 0.0)
    length = min(yard.between(0.45, 0.8) * room, 75.0)
    begin = margin + yard.between(0.0, room - length)
    return begin, begin + length


def place_tunnel(
    sides: tuple[StreetSide, StreetSide], span: tuple[float, float], yard: Yard
) -> None:
    """Walls with niches, a ceiling with fans, and retaining walls in front of the portals."""
    clear, roof = yard.between(*_CLEAR), yard.between(*_ROOF)
    reach = [yard.settings.corridor + yard.between(0.2, 1.2) for _ in sides]
    for side, away in zip(sides, reach, strict=True):
        _place_walls(side, span, away, clear + roof, yard)
        _place_retaining(side, span, away, clear, yard)
    left, right = sides
    width, aside = sum(reach) + 2 * _WALL + 3.0, (reach[0] - reach[1]) / 2
    count = max(int(np.ceil((span[1] - span[0]) / _TILE)), 1)
    tile = (span[1] - span[0]) / count
    for k in range(count):
        place = left.at(span[0] + (k + 0.5) * tile, aside)
        z = (clear, clear + roof)
        yard.slab(place, (tile, width), left.yaw, z, PointClass.STRUCTURE)
    for _ in range(int(yard.rng.poisson((span[1] - span[0]) / 18.0))):
        side = left if yard.chance(0.5) else right
        place = side.at(yard.between(*span), yard.between(0.0, 0.6) * reach[0])
        size = (yard.between(1.0, 3.0), yard.between(0.5, 1.0))
        z = (clear - yard.between(0.5, 1.1), clear)
        yard.slab(place, size, side.yaw, z, PointClass.STRUCTURE)


def _place_walls(
    side: StreetSide, span: tuple[float, float], away: float, height: float, yard: Yard
) -> None:
    """A wall in pieces, with a niche between two: wall to wall, so that no beam leaves."""
    position = span[0]
    while position < span[1]:
        stop = min(position + yard.between(5.0, 22.0), span[1])
        _wall(side, (position, stop), away, height, yard)
        position = stop
        stop = min(position + yard.between(1.5, 4.0), span[1])
        if stop > position:
            _wall(side, (position, stop), away + yard.between(0.5, 1.4), height, yard)
        position = stop
    if yard.chance(0.5):  # a walkway along a part of the wall
        begin, end = sorted((yard.between(*span), yard.between(*span)))
        place = side.at((begin + end) / 2, away)
        yard.box(place, (end - begin, 0.4, 0.9), side.yaw, PointClass.STRUCTURE, 0.5)


def _wall(
    side: StreetSide, span: tuple[float, float], away: float, height: float, yard: Yard
) -> None:
    """A piece of wall that begins ``away`` from the street's middle and fills the niche behind."""
    thick = _WALL + 1.5
    place = side.at(sum(span) / 2, away + thick / 2)
    size = (span[1] - span[0], thick, height)
    yard.box(place, size, side.yaw, PointClass.STRUCTURE, yard.between(0.4, 0.6))


def _place_retaining(
    side: StreetSide, span: tuple[float, float], away: float, height: float, yard: Yard
) -> None:
    """Walls that grow towards the portals."""
    room = max(min(span[0], side.length - span[1]) - yard.settings.corridor - 1.0, 0.0)
    length = min(yard.between(4.0, 16.0), room)
    steps = int(length / 2.0)
    for k in range(steps):
        tall = height * (1.0 - (k + 0.5) / steps)
        for along in (span[0] - 2.0 * k - 1.0, span[1] + 2.0 * k + 1.0):
            size = (2.0, _WALL, max(tall, 0.4))
            yard.box(side.at(along, away + _WALL / 2), size, side.yaw, PointClass.STRUCTURE, 0.5)

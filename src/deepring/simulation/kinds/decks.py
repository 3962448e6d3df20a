"""Parking decks over a street: pillars, a low ceiling, bays of parked cars, storeys above."""

import numpy as np

from deepring.simulation.furnish import occupied, park
from deepring.simulation.measures import LOWEST_CEILING
from deepring.simulation.shapes import PointClass
from deepring.simulation.yard import StreetSide, Yard

_CLEAR = (LOWEST_CEILING["tunnels"], 3.1)  # height of the ceiling
_SLAB, _STOREY = 0.35, 2.9  # thickness of a floor, and from one to the next
_TILE = 8.0  # the floors are laid in tiles, which follow the ground
_BAY = (2.5, 5.2)  # width and length of a parking bay
_LANE = 6.5  # between two rows of bays


def place_deck(
    sides: tuple[StreetSide, StreetSide], span: tuple[float, float], yard: Yard, cars: Yard
) -> None:
    """Build a deck over the part ``span`` of a street; the street is its middle lane."""
    reach = yard.settings.corridor + yard.between(13.0, 26.0)
    clear, storeys = yard.between(*_CLEAR), int(yard.rng.integers(1, 4))
    _lay_floors(sides[0], span, reach, clear, storeys, yard)
    pitch = yard.between(2.0, 3.0) * _BAY[0]
    for side in sides:
        _place_pillars(side, span, reach, clear, pitch, yard)
        _place_front(side, span, reach, clear, yard)
        _park_bays(side, span, reach, cars)


def _lay_floors(
    side: StreetSide,
    span: tuple[float, float],
    reach: float,
    clear: float,
    storeys: int,
    yard: Yard,
) -> None:
    """The ceiling and the floors above it, with a parapet around the highest."""
    length, width = span[1] - span[0], 2 * reach
    rows, columns = max(round(length / _TILE), 1), max(round(width / _TILE), 1)
    tile = (length / rows, width / columns)
    for row in range(rows):
        for column in range(columns):
            across = -reach + (column + 0.5) * tile[1]
            place = side.at(span[0] + (row + 0.5) * tile[0], across)
            for storey in range(storeys):
                z = clear + storey * _STOREY
                yard.slab(place, tile, side.yaw, (z, z + _SLAB), PointClass.STRUCTURE)
    for storey in range(storeys):
        floor = clear + storey * _STOREY
        parapet = (floor, floor + _SLAB + 1.1)
        for along in span:
            place = side.at(along, 0.0)
            yard.slab(place, (0.2, width), side.yaw, parapet, PointClass.STRUCTURE)
        for across in (-reach, reach):
            place = side.at(sum(span) / 2, across)
            yard.slab(place, (length, 0.2), side.yaw, parapet, PointClass.STRUCTURE)
    if yard.chance(0.5):  # a stairwell
        place = side.at(yard.between(*span), reach - 2.0)
        size = (5.0, 3.0, clear + storeys * _STOREY)
        yard.box(place, size, side.yaw, PointClass.STRUCTURE, 0.5)


def _place_pillars(
    side: StreetSide,
    span: tuple[float, float],
    reach: float,
    clear: float,
    pitch: float,
    yard: Yard,
) -> None:
    """Rows of pillars along the lanes, ``pitch`` metres apart."""
    size = yard.between(0.3, 0.6)
    first = yard.settings.corridor + 0.2 + size / 2
    begin = span[0] + yard.between(0.5, 2.0)
    for away in (first, *np.arange(first + _BAY[1] + 0.3, reach, _BAY[1] + 0.3)):
        for along in np.arange(begin, span[1], pitch):
            place = side.at(float(along), float(away))
            yard.box(place, (size, size, clear), side.yaw, PointClass.STRUCTURE, 0.5)


def _place_front(
    side: StreetSide, span: tuple[float, float], reach: float, clear: float, yard: Yard
) -> None:
    """The outer walls, up to the ceiling or only breast-high, with the street left open."""
    closed, length = yard.chance(0.5), span[1] - span[0]
    size = (length, 0.25, clear if closed else 1.0)
    yard.box(side.at(sum(span) / 2, reach), size, side.yaw, PointClass.STRUCTURE, 0.5)
    near = yard.settings.corridor + 0.4
    for along in span:
        if yard.chance(0.7):
            begin = near + yard.between(0.0, 6.0)
            height = clear if yard.chance(0.5) else 1.0
            place = side.at(along, (begin + reach) / 2)
            yard.box(place, (0.25, reach - begin, height), side.yaw, PointClass.STRUCTURE, 0.5)


def _park_bays(side: StreetSide, span: tuple[float, float], reach: float, cars: Yard) -> None:
    """Cars across the lanes, filled anew in each session."""
    across = StreetSide(side.start, side.away, side.along, 0.0).yaw
    near = cars.settings.corridor + 0.4
    away = near + _BAY[1] / 2
    while away + _BAY[1] / 2 < reach:
        for along in np.arange(span[0] + 2.0, span[1] - 1.0, _BAY[0]):
            for sessions in occupied(cars):
                park(side.at(float(along), away), across, cars, sessions)
        away += _BAY[1] + _LANE

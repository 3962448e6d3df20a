"""Plots without a house in a street of houses: greens, rows of garages, car parks."""

import numpy as np

from deepring.simulation.furnish import occupied, park, place_tree
from deepring.simulation.kinds.gardens import border, bush
from deepring.simulation.shapes import PointClass
from deepring.simulation.yard import StreetSide, Yard

Span = tuple[float, float]

_BAY = 2.5  # width of a parking bay and of a garage (metres)


def place_opening(side: StreetSide, span: Span, line: float, yard: Yard, cars: Yard) -> None:
    """One of the three on the plot ``span``, which begins ``line`` from the street's middle."""
    kind = int(yard.rng.integers(3))
    if kind == 0:
        _place_green(side, span, line, yard)
    elif kind == 1:
        _place_garages(side, span, line, yard)
    else:
        _place_car_park(side, span, line, yard, cars)


def _place_green(side: StreetSide, span: Span, line: float, yard: Yard) -> None:
    """A lawn or a playground: trees, bushes, benches, a low fence or none."""
    deep = yard.between(14.0, 26.0)
    for _ in range(int(yard.rng.poisson((span[1] - span[0]) * deep / 60.0))):
        place = side.at(yard.between(*span), line + yard.between(1.0, deep))
        if yard.chance(0.6):
            place_tree(place, yard)
        else:
            bush(place, yard)
    for _ in range(int(yard.rng.poisson(2.0))):
        place = side.at(yard.between(*span), line + yard.between(1.0, 8.0))
        size = (yard.between(1.4, 2.5), yard.between(0.5, 1.5), yard.between(0.6, 1.8))
        yard.box(place, size, yard.between(0.0, np.pi), PointClass.OTHER)
    if yard.chance(0.5):
        border(side.at(sum(span) / 2, line), span[1] - span[0], side.yaw, "fence", yard)


def _place_garages(side: StreetSide, span: Span, line: float, yard: Yard) -> None:
    """Garages wall to wall behind a forecourt."""
    front, depth, height = line + yard.between(5.0, 9.0), yard.between(5.5, 6.5), 2.5
    size = (span[1] - span[0], depth, height)
    place = side.at(sum(span) / 2, front + depth / 2)
    yard.box(place, size, side.yaw, PointClass.BUILDING, yard.between(0.4, 0.7))
    for along in np.arange(span[0], span[1], 1.2 * _BAY):  # pillars between the doors
        yard.box(
            side.at(float(along), front - 0.1), (0.35, 0.2, height), side.yaw, PointClass.BUILDING
        )


def _place_car_park(side: StreetSide, span: Span, line: float, yard: Yard, cars: Yard) -> None:
    """Bays across the street, in one or two rows, before a hedge."""
    across = StreetSide(side.start, side.away, side.along, 0.0).yaw
    rows = int(yard.rng.integers(1, 3))
    for row in range(rows):
        away = line + 3.0 + 11.0 * row
        for along in np.arange(span[0] + 1.5, span[1] - 1.0, _BAY):
            for sessions in occupied(cars):
                park(side.at(float(along), away), across, cars, sessions)
    back = line + 6.5 + 11.0 * (rows - 1)
    border(side.at(sum(span) / 2, back), span[1] - span[0], side.yaw, "hedge", yard)

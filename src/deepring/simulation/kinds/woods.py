"""Trees without buildings: roads through a wood, a park, meadows and scrub."""

import numpy as np

from deepring.simulation.furnish import park_row, place_lamps, place_tree
from deepring.simulation.kinds.gardens import border, bush, conifer
from deepring.simulation.shapes import PointClass
from deepring.simulation.streets import Streets
from deepring.simulation.yard import StreetSide, Yard, sides_of

_PATCH = (14.0, 34.0)  # length of road with one kind of land beside it (metres)
_DEEP = 30.0  # the land is planted up to here, beyond the free street
_VERGE = 1.2  # trees keep this distance from the free street


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Furnish both sides of every road, patch by patch."""
    for street in streets.all:
        for side in sides_of(street, streets):
            _furnish_side(side, yard, cars)


def _furnish_side(side: StreetSide, yard: Yard, cars: Yard) -> None:
    position = 0.0
    while position < side.length:
        stop = min(position + yard.between(*_PATCH), side.length)
        land = (_wood, _wood, _park, _meadow, _scrub)[int(yard.rng.integers(5))]
        land(side, (position, stop), yard)
        position = stop
    if yard.chance(0.3):
        place_lamps(side, yard.settings.corridor + 0.8, yard)
    if yard.chance(0.2):
        begin = yard.between(0.1, 0.5) * side.length
        end = begin + yard.between(12.0, 30.0)
        park_row(side, (begin, min(end, side.length - 8.0)), yard.settings.corridor + 1.2, cars)


def _spots(
    side: StreetSide, span: tuple[float, float], spacing: float, yard: Yard
) -> list[tuple[float, float]]:
    """World positions about ``spacing`` metres apart, beside the free street."""
    near = yard.settings.corridor + _VERGE
    spots = []
    for along in np.arange(span[0], span[1], spacing):
        for away in np.arange(near, near + _DEEP, spacing):
            reach = side.at(
                float(along) + yard.between(0.0, 0.9) * spacing,
                float(away) + yard.between(0.0, 0.9) * spacing,
            )
            spots.append(reach)
    return spots


def _wood(side: StreetSide, span: tuple[float, float], yard: Yard) -> None:
    """Tall trees, close together, broad-leaved or conifers or both."""
    conifers, spacing = yard.between(0.0, 1.0), yard.between(5.0, 8.0)
    for spot in _spots(side, span, spacing, yard):
        if yard.chance(0.2):
            continue
        sessions = yard.session(yard.settings.trees_changed)
        if yard.chance(conifers):
            conifer(spot, yard.between(6.0, 16.0), yard, sessions)
            continue
        base, radius = yard.between(2.5, 6.5), yard.between(1.6, 3.4)
        yard.post(spot, yard.between(0.1, 0.4), base + 1.0, PointClass.TRUNK, sessions)
        top = base + yard.between(3.0, 8.0)
        yard.crown(spot, radius, (base, top), yard.between(1.0, 2.5), sessions)


def _park(side: StreetSide, span: tuple[float, float], yard: Yard) -> None:
    """A lawn with single trees, bushes and benches."""
    for spot in _spots(side, span, yard.between(9.0, 13.0), yard):
        if yard.chance(0.6):
            place_tree(spot, yard)
        elif yard.chance(0.5):
            bush(spot, yard)
    for _ in range(int(yard.rng.poisson(1.0))):
        place = side.at(yard.between(*span), yard.settings.corridor + yard.between(0.8, 3.0))
        size = (yard.between(1.4, 2.0), 0.6, 0.8)
        yard.box(place, size, side.yaw + yard.between(-0.2, 0.2), PointClass.OTHER)


def _meadow(side: StreetSide, span: tuple[float, float], yard: Yard) -> None:
    """Open land behind a fence or a hedge, with bales, boulders and a few bushes."""
    near, length = yard.settings.corridor + yard.between(0.8, 2.5), span[1] - span[0]
    kind = ("fence", "hedge", "posts", "open")[int(yard.rng.integers(4))]
    if kind == "posts":
        for along in np.arange(span[0], span[1], 3.0):
            yard.post(side.at(float(along), near), 0.07, 1.2, PointClass.WALL)
    elif kind != "open":
        border(side.at(sum(span) / 2, near), length, side.yaw, kind, yard)
    for _ in range(int(yard.rng.poisson(length / 8.0))):
        place = side.at(yard.between(*span), near + yard.between(2.0, _DEEP))
        if yard.chance(0.5):
            bush(place, yard)
        else:
            sessions = yard.session(yard.settings.structures_changed)
            radius, height = yard.between(0.4, 1.0), yard.between(0.5, 1.4)
            yard.post(place, radius, height, PointClass.OTHER, sessions)


def _scrub(side: StreetSide, span: tuple[float, float], yard: Yard) -> None:
    """Bushes and young trees."""
    for spot in _spots(side, span, yard.between(4.5, 7.0), yard):
        if yard.chance(0.55):
            bush(spot, yard)
        elif yard.chance(0.25):
            conifer(spot, yard.between(2.0, 5.0), yard, yard.session(yard.settings.trees_changed))

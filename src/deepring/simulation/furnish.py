"""Places trees, poles, walls, clutter and cars along one side of a street."""

from collections.abc import Iterator

from deepring.simulation.shapes import BOTH, DATABASE, QUERY, PointClass
from deepring.simulation.yard import Character, StreetSide, Yard


def place_trees(side: StreetSide, character: Character, yard: Yard) -> None:
    """Place a row of trees along the street, with gaps, and sometimes a grove behind it."""
    row = yard.settings.corridor + yard.between(0.8, 2.5)
    position = yard.between(2.0, yard.settings.tree_spacing)
    while position < side.length:
        if yard.chance(0.7 * character.trees):
            place_tree(side.at(position, row + yard.between(-0.3, 0.8)), yard)
        position += yard.settings.tree_spacing * yard.between(0.7, 1.5)
    if yard.chance(0.35 * character.trees):
        middle, behind = yard.between(0.2, 0.8) * side.length, row + yard.between(12.0, 22.0)
        for _ in range(int(yard.rng.integers(4, 10))):
            spot = side.at(middle + yard.between(-9.0, 9.0), behind + yard.between(-7.0, 7.0))
            place_tree(spot, yard)


def place_tree(place: tuple[float, float], yard: Yard) -> None:
    """Plant a broad-leaved tree, or in a share of the calls only in one session."""
    sessions = yard.session(yard.settings.trees_changed)
    base, top = yard.between(2.0, 3.5), yard.between(5.0, 10.0)
    radius, depth = yard.between(1.6, 4.0), yard.between(1.0, 2.5)
    yard.post(place, yard.between(0.12, 0.35), base + 1.0, PointClass.TRUNK, sessions)
    yard.crown(place, radius, (base, top), depth, sessions)


def place_structures(side: StreetSide, yard: Yard) -> None:
    """Place poles at the kerb, walls, sheds and small clutter."""
    place_lamps(side, yard.settings.corridor + 0.3, yard)
    for _ in range(int(yard.rng.poisson(side.length / 90.0))):
        size = (yard.between(6.0, 16.0), 0.3, yard.between(1.2, 2.6))
        scatter(side, size, (2.5, 4.0), PointClass.WALL, yard)
    for _ in range(int(yard.rng.poisson(side.length / 80.0))):
        size = (yard.between(2.0, 6.5), yard.between(2.0, 3.5), yard.between(2.2, 3.5))
        scatter(side, size, (3.0, 26.0), PointClass.BUILDING, yard)
    for _ in range(int(yard.rng.poisson(side.length / 20.0))):
        size = (yard.between(0.4, 1.8), yard.between(0.4, 0.9), yard.between(0.7, 1.6))
        scatter(side, size, (0.5, 4.0), PointClass.OTHER, yard)


def place_lamps(side: StreetSide, away: float, yard: Yard) -> None:
    """Place lamp posts ``away`` metres from the street's middle."""
    position = yard.between(5.0, 30.0)
    while position < side.length:
        radius, height = yard.between(0.08, 0.2), yard.between(4.0, 9.0)
        yard.post(side.at(position, away), radius, height, PointClass.POLE)
        position += yard.between(22.0, 38.0)


def scatter(
    side: StreetSide,
    size: tuple[float, float, float],
    band: tuple[float, float],
    kind: PointClass,
    yard: Yard,
) -> None:
    """Place one box at random along the side, ``band`` metres beyond the corridor."""
    away = yard.settings.corridor + size[1] / 2 + yard.between(*band)
    place = side.at(yard.between(0.0, side.length), away)
    yaw = side.yaw + yard.between(-0.05, 0.05)
    shade, sessions = yard.between(0.2, 0.6), yard.session(yard.settings.structures_changed)
    yard.box(place, size, yaw, kind, shade, sessions)


def park_cars(side: StreetSide, yard: Yard, cars: Yard) -> None:
    """Fill a row of parking slots, differently in each session.

    ``yard`` draws the slots, ``cars`` the cars in them.
    """
    if not yard.chance(0.5):
        return
    row, position = yard.settings.corridor + 1.2, yard.between(12.0, 30.0)
    end = yard.between(0.5, 1.0) * side.length - 12.0
    park_row(side, (position, end), row, cars)


def park_row(
    side: StreetSide, span: tuple[float, float], away: float, cars: Yard, slot: float = 6.0
) -> None:
    """Park cars along the street in slots of ``slot`` metres."""
    position, end = span
    while position < end:
        for sessions in occupied(cars):
            park(side.at(position + cars.between(-0.4, 0.4), away), side.yaw, cars, sessions)
        position += slot


def occupied(cars: Yard, factor: float = 1.0) -> Iterator[int]:
    """The sessions in which a car stands in a slot: one car in both, or up to one in each.

    ``factor`` times ``parking_share`` is the chance of a car. Draws lazily: park before the next.
    """
    share, changed = factor * cars.settings.parking_share, cars.settings.parking_changed
    if changed < 1.0 and not cars.chance(changed):
        if cars.chance(share):
            yield BOTH
        return
    for session in (DATABASE, QUERY):
        if cars.chance(share):
            yield session


def park(place: tuple[float, float], yaw: float, cars: Yard, sessions: int) -> None:
    """Park a car or a van at ``place``."""
    van = cars.chance(0.15)
    height = cars.between(2.0, 2.6) if van else cars.between(1.4, 1.8)
    size = (cars.between(4.8, 5.6) if van else cars.between(3.8, 4.8), 1.8, height)
    yaw += cars.between(-0.04, 0.04)
    cars.box(place, size, yaw, PointClass.PARKED_CAR, cars.between(0.2, 0.9), sessions)

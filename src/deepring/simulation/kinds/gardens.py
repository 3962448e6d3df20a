"""Gardens: what encloses them, and the trees, bushes, sheds and cars in them."""

from dataclasses import replace

from deepring.simulation.furnish import occupied, park
from deepring.simulation.kinds.houses import VILLA, draw_house, place_house
from deepring.simulation.shapes import PointClass
from deepring.simulation.yard import StreetSide, Yard

_BORDERS = ("hedge", "hedge", "wall", "fence", "fence", "open")
_DRIVE = 3.2  # width of a drive to a garage (metres)


def place_border(side: StreetSide, span: tuple[float, float], away: float, yard: Yard) -> None:
    """Enclose a garden along the street, by a hedge, a wall or a fence, or leave it open."""
    kind = _BORDERS[int(yard.rng.integers(len(_BORDERS)))]
    length = span[1] - span[0]
    if kind == "open" or length < 0.5:
        return
    border(side.at(sum(span) / 2, away), length, side.yaw, kind, yard)


def border(place: tuple[float, float], length: float, yaw: float, kind: str, yard: Yard) -> None:
    """A hedge, a wall or a fence with its middle at ``place``."""
    if kind == "hedge":
        size = (length, yard.between(0.5, 1.1), yard.between(0.9, 2.2))
        yard.hedge(place, size, yaw, yard.between(0.1, 0.3))
    elif kind == "wall":
        size = (length, yard.between(0.2, 0.35), yard.between(0.5, 1.6))
        yard.box(place, size, yaw, PointClass.WALL, yard.between(0.3, 0.7))
    else:
        size = (length, 0.08, yard.between(0.8, 1.7))
        yard.hedge(place, size, yaw, yard.between(0.04, 0.2), PointClass.WALL)


def place_villa(
    side: StreetSide, span: tuple[float, float], line: float, yard: Yard, cars: Yard
) -> None:
    """A house in its garden on the plot ``span``, whose border is ``line`` from the middle."""
    begin, end = span
    house = draw_house(VILLA, yard)
    house = replace(house, width=min(house.width, end - begin - _DRIVE - 1.5))
    front = line + yard.between(2.5, 7.5)
    drive_first = yard.chance(0.5)
    drive = begin + _DRIVE / 2 if drive_first else end - _DRIVE / 2
    low, high = (begin + _DRIVE, end - 1.0) if drive_first else (begin + 1.0, end - _DRIVE)
    middle = yard.between(low + house.width / 2, high - house.width / 2)
    parts = int(yard.rng.poisson(VILLA.parts))
    place_house(side, (middle, front), house, yard, parts=parts)

    has_drive = yard.chance(0.8)
    border_low = begin if not has_drive or not drive_first else begin + _DRIVE
    border_high = end if not has_drive or drive_first else end - _DRIVE
    place_border(side, (border_low, border_high), line, yard)
    _divide(side, end, (line, front + house.depth + yard.between(2.0, 10.0)), yard)
    if has_drive:
        _place_drive(side, drive, (line, front), yard, cars)
    _plant(side, span, (line + 0.8, front - 0.8), int(yard.rng.integers(0, 4)), yard)
    behind = front + house.depth
    _plant(side, span, (behind + 2.0, behind + 14.0), int(yard.rng.integers(1, 5)), yard)


def _divide(side: StreetSide, along: float, reach: tuple[float, float], yard: Yard) -> None:
    """The border to the neighbour, away from the street."""
    kind = _BORDERS[int(yard.rng.integers(len(_BORDERS)))]
    if kind == "open":
        return
    across = StreetSide(side.start, side.away, side.along, reach[1])
    border(side.at(along, sum(reach) / 2), reach[1] - reach[0], across.yaw, kind, yard)


def _place_drive(
    side: StreetSide, along: float, reach: tuple[float, float], yard: Yard, cars: Yard
) -> None:
    """A drive to a garage beside the house, with or without a car."""
    line, front = reach
    back = front + yard.between(0.0, 4.0)
    if yard.chance(0.7):
        size = (_DRIVE - 0.2, yard.between(5.0, 7.0), yard.between(2.3, 3.0))
        place = side.at(along, back + size[1] / 2)
        yard.box(place, size, side.yaw, PointClass.BUILDING, yard.between(0.3, 0.7))
    if back - line < 5.2:
        return
    across = StreetSide(side.start, side.away, side.along, 0.0).yaw
    for sessions in occupied(cars, 0.7):
        park(side.at(along, cars.between(line + 2.6, back - 2.6)), across, cars, sessions)


def _plant(
    side: StreetSide,
    span: tuple[float, float],
    band: tuple[float, float],
    count: int,
    yard: Yard,
) -> None:
    """Bushes and small trees at random between the distances ``band`` from the street's middle."""
    if band[1] <= band[0]:
        return
    for _ in range(count):
        place = side.at(yard.between(*span), yard.between(*band))
        if yard.chance(0.55):
            bush(place, yard)
        else:
            garden_tree(place, yard)


def bush(place: tuple[float, float], yard: Yard) -> None:
    """A bush, dense down to the ground."""
    top, radius = yard.between(0.5, 2.2), yard.between(0.3, 1.2)
    sessions = yard.session(yard.settings.trees_changed)
    yard.crown(place, radius, (-0.3, top), yard.between(0.15, 0.6), sessions)


def garden_tree(place: tuple[float, float], yard: Yard) -> None:
    """A small tree, broad-leaved or a conifer with foliage almost down to the ground."""
    sessions = yard.session(yard.settings.trees_changed)
    if yard.chance(0.3):
        conifer(place, yard.between(3.0, 9.0), yard, sessions)
        return
    base, radius = yard.between(1.9, 2.6), yard.between(1.0, 2.8)
    yard.post(place, yard.between(0.07, 0.2), base + 0.6, PointClass.TRUNK, sessions)
    yard.crown(
        place, radius, (base, base + yard.between(2.0, 5.0)), yard.between(0.6, 1.6), sessions
    )


def conifer(place: tuple[float, float], height: float, yard: Yard, sessions: int) -> None:
    """A conifer: its trunk, and three tiers of foliage."""
    radius, base = 0.12 * height + yard.between(0.4, 1.0), yard.between(0.3, 1.5)
    yard.post(place, yard.between(0.08, 0.25), base + 0.5, PointClass.TRUNK, sessions)
    tier, depth = (height - base) / 3, yard.between(0.3, 0.9)
    for k, share in enumerate((1.0, 0.7, 0.35)):
        z = (base + k * tier, base + (k + 1) * tier)
        yard.crown(place, share * radius, z, depth, sessions)

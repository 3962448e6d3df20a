"""Houses side by side in rows, and houses that stand alone, with roofs, bays, steps, balconies."""

from dataclasses import dataclass

from deepring.simulation.shapes import PointClass
from deepring.simulation.yard import StreetSide, Yard

Range = tuple[float, float]


@dataclass(frozen=True)
class HouseStyle:
    """The range of each measure of a house (metres)."""

    width: Range  # along the street
    depth: Range
    eaves: Range  # height of the walls
    rise: Range  # of the roof above the eaves
    shift: float  # largest offset of a front from its row's line
    uneven: float  # largest difference of a house's eaves from its row's
    parts: float  # mean number of parts in front of the wall


#: An old town's houses, each of another height, and a row that one builder built.
TOWN = HouseStyle((5.0, 12.0), (9.0, 14.0), (7.0, 12.0), (2.0, 5.0), 0.35, 3.0, 2.0)
TERRACE = HouseStyle((5.0, 7.5), (8.0, 10.0), (4.5, 6.5), (2.5, 4.0), 0.2, 0.2, 2.0)
#: A house in its garden.
VILLA = HouseStyle((7.5, 12.0), (8.0, 11.0), (2.8, 6.5), (2.0, 4.0), 0.0, 0.0, 2.5)


@dataclass(frozen=True)
class House:
    """One house: its width, depth, eaves and ridge (metres)."""

    width: float
    depth: float
    eaves: float
    ridge: float


def place_row(side: StreetSide, span: Range, front: float, style: HouseStyle, yard: Yard) -> None:
    """Houses wall to wall over ``span`` of the side, ``front`` metres from the street's middle."""
    position, end = span
    eaves, depth = yard.between(*style.eaves), yard.between(*style.depth)
    rise, width = yard.between(*style.rise), yard.between(*style.width)
    while end - position > 0.5:
        if style.uneven > 1.0:
            width = yard.between(*style.width)
        rest = end - position - width
        here = width if rest >= style.width[0] else end - position  # none is left over
        wall = max(eaves + yard.between(-style.uneven, style.uneven), 2.6)
        line = front + yard.between(-style.shift, style.shift)
        place_house(
            side,
            (position + here / 2, line),
            House(here, depth, wall, wall + rise),
            yard,
            parts=int(yard.rng.poisson(style.parts * here / 7.0)),
        )
        position += here


def draw_house(style: HouseStyle, yard: Yard) -> House:
    """A house of a style."""
    eaves = yard.between(*style.eaves)
    return House(
        width=yard.between(*style.width),
        depth=yard.between(*style.depth),
        eaves=eaves,
        ridge=eaves + yard.between(*style.rise),
    )


def place_house(
    side: StreetSide, front: tuple[float, float], house: House, yard: Yard, *, parts: int
) -> None:
    """Build a house with the middle of its front at ``front`` (along, away) and ``parts`` on it.

    The roof is two boxes of growing height, with the ridge along the street.
    """
    along, line = front
    middle = line + house.depth / 2
    shade = yard.between(0.25, 0.75)
    rise = house.ridge - house.eaves
    for share, height in ((1.0, 0.0), (0.65, 0.5), (0.25, 1.0)):
        size = (house.width, share * house.depth, house.eaves + height * rise)
        yard.box(side.at(along, middle), size, side.yaw, PointClass.BUILDING, shade)
    for _ in range(parts):
        _place_part(side, front, house, shade, yard)


def _place_part(
    side: StreetSide, front: tuple[float, float], house: House, shade: float, yard: Yard
) -> None:
    """A bay, a porch, steps or a balcony in front of the wall."""
    length = min(yard.between(1.0, 3.0), house.width - 0.4)
    along = front[0] + yard.between(-0.5, 0.5) * (house.width - length)
    kind = int(yard.rng.integers(4))
    if kind == 3 and house.eaves > 5.0:
        depth, floor = yard.between(0.6, 1.4), yard.between(2.6, 2.9)
        place = side.at(along, front[1] - depth / 2)
        z = (floor, floor + 1.1)
        yard.slab(place, (length, depth), side.yaw, z, PointClass.BUILDING)
        return
    depth = (yard.between(0.4, 1.0), yard.between(0.6, 1.5), yard.between(0.3, 0.9), 0.5)[kind]
    height = (house.eaves, yard.between(2.2, 2.7), yard.between(0.3, 0.8), 2.4)[kind]
    place = side.at(along, front[1] - depth / 2)
    yard.box(place, (length, depth, height), side.yaw, PointClass.BUILDING, shade)

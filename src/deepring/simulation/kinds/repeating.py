"""Streets that repeat: the same facade, period after period, so that places look alike."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deepring.simulation.furnish import park_row, place_tree
from deepring.simulation.kinds.gardens import border
from deepring.simulation.kinds.kerbs import place_kerbside
from deepring.simulation.shapes import PointClass
from deepring.simulation.streets import Streets
from deepring.simulation.yard import StreetSide, Yard, sides_of

_PATTERNS = 3  # in a world
_PAVEMENT = (3.5, 6.0)  # between the free street and the facades


@dataclass(frozen=True)
class PatternPart:
    """One box of a pattern: position along the period, distance behind the front, and size."""

    along: float
    away: float
    size: tuple[float, float, float]
    kind: PointClass


@dataclass(frozen=True)
class Pattern:
    """What repeats: boxes, a lamp, and a hedge or fence in front of a part of the period."""

    parts: tuple[PatternPart, ...]
    lamp: float  # position of the lamp post
    border: tuple[float, float]  # begin and end
    kind: str  # of the border
    setback: float


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Repeat one of a few patterns along each side of every street."""
    patterns = [draw_pattern(yard.settings.period, yard) for _ in range(_PATTERNS)]
    for street in streets.all:
        for side in sides_of(street, streets):
            pattern = patterns[int(yard.rng.integers(len(patterns)))]
            line = yard.settings.corridor + yard.between(*_PAVEMENT)
            repeat(side, line, pattern, yard)
            _place_what_differs(side, line, yard, cars)


def draw_pattern(period: float, yard: Yard) -> Pattern:
    """Slabs of flats or terraced houses with gaps, bays and stairs, ``period`` metres long."""
    height, depth = yard.between(6.0, 15.0), yard.between(8.0, 12.0)
    gap = yard.between(0.0, 0.3) * period if yard.chance(0.7) else 0.0
    width = period - gap
    parts = [PatternPart(width / 2, depth / 2, (width, depth, height), PointClass.BUILDING)]
    if yard.chance(0.5):  # a lower wing, set forward
        wing = yard.between(0.2, 0.4) * width
        size = (wing, yard.between(1.0, 3.0), yard.between(0.4, 1.0) * height)
        along = yard.between(wing / 2, width - wing / 2)
        parts.append(PatternPart(along, -size[1] / 2, size, PointClass.BUILDING))
    for _ in range(int(yard.rng.integers(2, 6))):
        size = (yard.between(1.0, 3.5), yard.between(0.4, 1.5), yard.between(0.5, height))
        along = yard.between(size[0] / 2, width - size[0] / 2)
        parts.append(PatternPart(along, -size[1] / 2, size, PointClass.BUILDING))
    if gap > 3.5:  # a garage in the gap, set back
        size = (3.2, 6.0, 2.6)
        parts.append(PatternPart(width + gap / 2, 6.0, size, PointClass.BUILDING))
    begin = yard.between(0.0, 0.4) * period
    return Pattern(
        parts=tuple(parts),
        lamp=yard.between(0.0, period),
        border=(begin, begin + yard.between(0.3, 0.6) * period),
        kind=("hedge", "wall", "fence")[int(yard.rng.integers(3))],
        setback=yard.between(3.2, 6.0),
    )


def repeat(side: StreetSide, line: float, pattern: Pattern, yard: Yard) -> None:
    """Place as many whole periods as fit between the crossings of a side."""
    period = yard.settings.period
    begin, end = side.span(line + 1.0)
    front = line + pattern.setback
    place_border = _same_border(pattern, yard)
    for start in begin + period * np.arange(int((end - begin) / period + 1e-9)):
        for part in pattern.parts:
            place = side.at(float(start) + part.along, front + part.away)
            yard.box(place, part.size, side.yaw, part.kind, 0.5)
        yard.post(side.at(float(start) + pattern.lamp, line - 0.5), 0.1, 6.0, PointClass.POLE)
        middle = float(start) + sum(pattern.border) / 2
        place_border(side.at(middle, line), side.yaw)


def _same_border(pattern: Pattern, yard: Yard) -> Callable[[tuple[float, float], float], None]:
    """Places the pattern's border: its height and density are drawn once for a side."""
    seed = int(yard.rng.integers(2**31))
    length = pattern.border[1] - pattern.border[0]

    def place(where: tuple[float, float], yaw: float) -> None:
        again = Yard(yard.settings, yard.ground, yard.prisms, np.random.default_rng(seed))
        border(where, length, yaw, pattern.kind, again)

    return place


def _place_what_differs(side: StreetSide, line: float, yard: Yard, cars: Yard) -> None:
    """Trees, parked cars and small things, which follow no period."""
    begin, end = side.span(line + 1.0)
    position = begin + yard.between(0.0, yard.settings.tree_spacing)
    while position < end:
        if yard.chance(0.5):
            place_tree(side.at(position, line - 0.9), yard)
        position += yard.settings.tree_spacing * yard.between(0.6, 1.8)
    place_kerbside(side, line - 0.6, yard)
    if yard.chance(0.6):
        start = begin + yard.between(0.0, 15.0)
        park_row(side, (start, end - 4.0), yard.settings.corridor + 1.0, cars)

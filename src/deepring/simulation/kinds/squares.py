"""Open squares at the crossings, with facades around them and short streets between."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.furnish import park_row, place_lamps, place_tree
from deepring.simulation.kinds.gardens import border
from deepring.simulation.kinds.houses import TOWN, place_row
from deepring.simulation.kinds.kerbs import place_kerbside
from deepring.simulation.shapes import PointClass
from deepring.simulation.streets import Streets
from deepring.simulation.yard import StreetSide, Yard, sides_of

_SHARE = 0.7  # of the crossings that are squares
_HALF = (0.14, 0.3)  # half a side of a square, as a share of a block
_PAVEMENT = (3.0, 5.0)  # between the free street and its facades


@dataclass(frozen=True, eq=False)
class Square:
    """A rectangle around a crossing: its middle (2,), axes (2, 2) as rows, half sides (metres)."""

    middle: NDArray[np.float64]
    axes: NDArray[np.float64]
    half: tuple[float, float]

    def edges(self) -> list[StreetSide]:
        """The four edges, each with the direction away from the square."""
        u, v = self.axes
        a, b = self.half
        edges = []
        for along, away, length, reach in (
            (u, v, a, b),
            (v, -u, b, a),
            (-u, -v, a, b),
            (-v, u, b, a),
        ):
            start = self.middle + reach * away - length * along
            edges.append(StreetSide(start, along, away, 2 * length, (False, False)))
        return edges

    def at(self, u: float, v: float) -> tuple[float, float]:
        """World position of the shares ``u``, ``v`` of the half sides."""
        x, y = self.middle + u * self.half[0] * self.axes[0] + v * self.half[1] * self.axes[1]
        return float(x), float(y)

    @property
    def yaw(self) -> float:
        """Direction of the first axis (rad)."""
        return float(np.arctan2(self.axes[0, 1], self.axes[0, 0]))

    def leaves_at(self, way: NDArray[np.float64]) -> float:
        """How far from the middle a street of direction ``way`` leaves the square (metres)."""
        u, v = np.abs(self.axes @ way)
        return float(min(self.half[0] / max(u, 1e-9), self.half[1] / max(v, 1e-9)))


def furnish(streets: Streets, yard: Yard, cars: Yard) -> None:
    """Draw the squares, furnish them, and the streets between them."""
    squares = {
        crossing: draw_square(streets.crossings[crossing], yard)
        for crossing in range(len(streets.crossings))
        if yard.chance(_SHARE)
    }
    for square in squares.values():
        _furnish_square(square, yard, cars)
    for street in streets.all:
        for side in sides_of(street, streets):
            begin, end = (
                squares[crossing].leaves_at(side.along) if crossing in squares else 0.0
                for crossing in street
            )
            if begin + end + 10.0 < side.length:
                _furnish_street(side.part(begin, side.length - end), yard, cars)


def draw_square(middle: NDArray[np.float64], yard: Yard) -> Square:
    """A square around ``middle``, turned at random."""
    turn = yard.between(0.0, np.pi / 2)
    c, s = np.cos(turn), np.sin(turn)
    half = [yard.between(*_HALF) * yard.settings.block for _ in range(2)]
    return Square(middle, np.array([[c, s], [-s, c]]), (half[0], half[1]))


def _furnish_street(side: StreetSide, yard: Yard, cars: Yard) -> None:
    """Facades up to the squares or crossings at its ends."""
    line = yard.settings.corridor + yard.between(*_PAVEMENT)
    place_row(side, side.span(line + 0.5), line, TOWN, yard)
    place_lamps(side, line - 0.8, yard)
    place_kerbside(side, line - 0.8, yard)
    if yard.chance(0.4):
        begin, end = side.span(line + 4.0)
        park_row(side, (begin + 3.0, end - 3.0), yard.settings.corridor + 1.0, cars)


def _furnish_square(square: Square, yard: Yard, cars: Yard) -> None:
    """Facades around the square, and what stands on it; streets are cleared afterwards."""
    for edge in square.edges():
        place_row(edge, (0.0, edge.length), 0.0, TOWN, yard)
        if yard.chance(0.35):
            inner = StreetSide(edge.start, edge.along, -edge.away, edge.length)
            park_row(inner, (4.0, edge.length - 4.0), 4.0, cars)
    _place_monument(square, yard)
    (_place_market, _place_garden, _place_pavement)[int(yard.rng.integers(3))](square, yard)
    for _ in range(int(yard.rng.integers(4, 10))):
        place = square.at(yard.between(-0.85, 0.85), yard.between(-0.85, 0.85))
        yard.post(place, yard.between(0.06, 0.15), yard.between(4.0, 8.0), PointClass.POLE)


def _place_monument(square: Square, yard: Yard) -> None:
    """A column, a fountain or a statue on its base, beside the streets that cross the square."""
    place = square.at(yard.between(-0.6, 0.6), yard.between(-0.6, 0.6))
    base = yard.between(2.0, 6.0)
    yard.box(place, (base, base, yard.between(0.4, 1.5)), square.yaw, PointClass.OTHER, 0.5)
    yard.post(place, yard.between(0.4, 0.2 * base), yard.between(3.0, 12.0), PointClass.OTHER)


def _place_market(square: Square, yard: Yard) -> None:
    """Stalls in rows, some of them there in one session alone."""
    for u in np.linspace(-0.7, 0.7, int(yard.rng.integers(3, 7))):
        for v in np.linspace(-0.7, 0.7, int(yard.rng.integers(3, 6))):
            if yard.chance(0.5):
                size = (yard.between(2.0, 4.5), yard.between(1.8, 2.6), yard.between(2.2, 3.0))
                sessions = yard.session(yard.settings.structures_changed)
                place = square.at(float(u), float(v))
                yard.box(place, size, square.yaw, PointClass.OTHER, 0.5, sessions)


def _place_garden(square: Square, yard: Yard) -> None:
    """Trees in rows, and hedges around beds."""
    count = int(yard.rng.integers(3, 6))
    for u in np.linspace(-0.75, 0.75, count):
        for v in np.linspace(-0.75, 0.75, count):
            if yard.chance(0.6):
                place = square.at(float(u), float(v))
                place_tree(place, yard)
    for _ in range(int(yard.rng.integers(2, 7))):
        place = square.at(yard.between(-0.7, 0.7), yard.between(-0.7, 0.7))
        border(place, yard.between(3.0, 10.0), square.yaw, "hedge", yard)


def _place_pavement(square: Square, yard: Yard) -> None:
    """An empty square with benches, planters and a kiosk."""
    for _ in range(int(yard.rng.poisson(9.0))):
        size = (yard.between(0.8, 2.4), yard.between(0.5, 1.0), yard.between(0.5, 1.2))
        place = square.at(yard.between(-0.9, 0.9), yard.between(-0.9, 0.9))
        sessions = yard.session(yard.settings.structures_changed)
        yard.box(place, size, yard.between(0.0, np.pi), PointClass.OTHER, 0.4, sessions)
    size = (yard.between(2.5, 5.0), yard.between(2.5, 4.0), yard.between(2.5, 3.5))
    place = square.at(yard.between(-0.7, 0.7), yard.between(-0.7, 0.7))
    yard.box(place, size, square.yaw, PointClass.BUILDING, 0.5)

"""Helpers to place objects: sides of streets, and random numbers."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.ground import Ground
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.shapes import BOTH, DATABASE, QUERY, PointClass, PrismList
from deepring.simulation.streets import Street, Streets

FloatArray = NDArray[np.float64]

_FOOT = 0.6  # depth of objects below the ground, so that none floats on a slope


@dataclass(frozen=True, eq=False)
class StreetSide:
    """One side of a street: its start, its direction and the direction away from it.

    ``crossings`` tells of its start and of its end whether other streets meet it there; where it
    only bends, or goes on in another part, none does.
    """

    start: FloatArray
    along: FloatArray
    away: FloatArray
    length: float
    crossings: tuple[bool, bool] = (True, True)

    @property
    def yaw(self) -> float:
        """Direction of the street (rad)."""
        return float(np.arctan2(self.along[1], self.along[0]))

    def at(self, along: float, away: float) -> tuple[float, float]:
        """World position ``along`` the street and ``away`` from its middle (metres)."""
        x, y = self.start + along * self.along + away * self.away
        return float(x), float(y)

    def span(self, margin: float) -> tuple[float, float]:
        """Where a row of objects begins and ends that keeps ``margin`` metres from crossings."""
        begin, end = (margin if crossing else 0.0 for crossing in self.crossings)
        return begin, self.length - end

    def part(self, begin: float, end: float) -> "StreetSide":
        """The part of the side from ``begin`` to ``end``, without crossings at new ends."""
        crossings = (
            self.crossings[0] and begin <= 0.0,
            self.crossings[1] and end >= self.length,
        )
        start = self.start + begin * self.along
        return replace(self, start=start, length=end - begin, crossings=crossings)


def sides_of(street: Street, streets: Streets) -> tuple[StreetSide, StreetSide]:
    """Left and right side of a street."""
    start, length = streets.crossings[street[0]], streets.length(street)
    along = (streets.crossings[street[1]] - start) / length
    left = np.array([-along[1], along[0]])
    meets = (street[0] not in streets.bends, street[1] not in streets.bends)
    return (
        StreetSide(start, along, left, length, meets),
        StreetSide(start, along, -left, length, meets),
    )


@dataclass(frozen=True)
class Character:
    """The difference of one side of a street from the average."""

    height: float  # factor of the buildings' heights
    setback: float  # metres added between the street and its buildings
    trees: float  # factor of the number of trees
    built: float  # factor of the share of plots with a building


@dataclass(frozen=True, eq=False)
class Yard:
    """The settings, the ground, the list of prisms to fill, and random numbers."""

    settings: SimulationSettings
    ground: Ground
    prisms: PrismList
    rng: np.random.Generator

    def between(self, low: float, high: float) -> float:
        """A uniform draw."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True with probability ``share``."""
        return bool(self.rng.random() < share)

    def character(self) -> Character:
        """Draw a side's character; ``street_variety`` scales its difference from the average."""
        v = self.settings.street_variety
        return Character(
            height=2.0 ** self.between(-0.8 * v, 0.8 * v),
            setback=self.between(0.0, 12.0 * v),
            trees=1.0 + self.between(-0.8 * v, 0.6 * v),
            built=1.0 + self.between(-0.6 * v, 0.2 * v),
        )

    def session(self, change: float) -> int:
        """BOTH, or with probability ``change`` only one session."""
        if not self.chance(change):
            return BOTH
        return DATABASE if self.chance(0.5) else QUERY

    def level(self, place: tuple[float, float]) -> float:
        """The ground's height at ``place`` (metres)."""
        return float(self.ground.height(np.asarray(place[0]), np.asarray(place[1])))

    def box(
        self,
        place: tuple[float, float],
        size: tuple[float, float, float],
        yaw: float,
        kind: PointClass,
        shade: float = 0.4,
        sessions: int = BOTH,
    ) -> None:
        """Stand a box of ``size`` (length, width, height) on the ground."""
        base = self.level(place)
        z = (base - _FOOT, base + size[2])
        self.prisms.box(place, size[:2], yaw, z, reflectance=shade, sessions=sessions, kind=kind)

    def post(
        self,
        place: tuple[float, float],
        radius: float,
        height: float,
        kind: PointClass,
        sessions: int = BOTH,
    ) -> None:
        """Stand an opaque cylinder on the ground."""
        base = self.level(place)
        span = (base - _FOOT, base + height)
        self.prisms.cylinder(place, radius, span, sessions=sessions, kind=kind)

    def crown(
        self,
        place: tuple[float, float],
        radius: float,
        z: tuple[float, float],
        depth: float,
        sessions: int = BOTH,
    ) -> None:
        """Hang foliage over ``place``, between the heights ``z`` above the ground."""
        base = self.level(place)
        span = (base + z[0], base + z[1])
        self.prisms.cylinder(
            place,
            radius,
            span,
            depth=depth,
            reflectance=0.55,
            sessions=sessions,
            kind=PointClass.CROWN,
        )

    def slab(
        self,
        place: tuple[float, float],
        size: tuple[float, float],
        yaw: float,
        z: tuple[float, float],
        kind: PointClass,
        sessions: int = BOTH,
    ) -> None:
        """Hang a box of ``size`` (length, width) between the heights ``z`` above the ground."""
        base = self.level(place)
        span = (base + z[0], base + z[1])
        self.prisms.box(place, size, yaw, span, sessions=sessions, kind=kind, grounded=False)

    def hedge(
        self,
        place: tuple[float, float],
        size: tuple[float, float, float],
        yaw: float,
        depth: float,
        kind: PointClass = PointClass.CROWN,
        sessions: int = BOTH,
    ) -> None:
        """Stand a box of ``size`` (length, width, height) that beams enter, a hedge or a fence.

        ``depth`` is the mean free path of a beam inside (metres).
        """
        base = self.level(place)
        span = (base - _FOOT, base + size[2])
        self.prisms.box(
            place,
            size[:2],
            yaw,
            span,
            depth=depth,
            reflectance=0.5,
            sessions=sessions,
            kind=kind,
        )

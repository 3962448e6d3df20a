"""Building prototypes of shape I, L, U or T, with protrusions on their facades."""

from dataclasses import dataclass

import numpy as np

from deepring.simulation.settings import SimulationSettings


@dataclass(frozen=True)
class BuildingPart:
    """One box of a building: its centre along the street and away from it, and its size."""

    along: float
    away: float
    length: float
    depth: float
    height: float

    def faces_street_at(self, along: float) -> bool:
        """True if the box spans the position ``along``."""
        return abs(along - self.along) <= self.length / 2


@dataclass(frozen=True)
class Building:
    """Boxes relative to the middle of the plot's front, metres.

    ``walls`` are the building itself; ``facade`` is the bays, porches and stairs in front of it.
    """

    width: float
    walls: tuple[BuildingPart, ...]
    facade: tuple[BuildingPart, ...]


def draw_prototypes(settings: SimulationSettings, rng: np.random.Generator) -> list[Building]:
    """``building_prototypes`` random buildings; each building of the world is a copy of one."""
    kinds = rng.permutation(4)
    return [
        _draw_building(int(kinds[i % 4]), settings, rng)
        for i in range(settings.building_prototypes)
    ]


def _draw_building(kind: int, settings: SimulationSettings, rng: np.random.Generator) -> Building:
    width, bar, wing = rng.uniform(20.0, 32.0), rng.uniform(7.0, 11.0), rng.uniform(6.0, 12.0)
    height = rng.uniform(9.0, 24.0) if settings.world == "city" else rng.uniform(6.0, 14.0)
    walls = _walls(kind, width, bar, wing, height)
    count = int(rng.poisson(settings.facade_parts))
    return Building(width, walls, tuple(_protrusion(walls, width, rng) for _ in range(count)))


def _walls(
    kind: int, width: float, bar: float, wing: float, height: float
) -> tuple[BuildingPart, ...]:
    """A bar along the street (I, L) or set back behind wings (U, T)."""
    lower, side = 0.8 * height, width / 2 - bar / 2
    front = BuildingPart(0.0, bar / 2, width, bar, height)
    back = BuildingPart(0.0, wing + bar / 2, width, bar, height)
    if kind == 0:  # I
        return (front,)
    if kind == 1:  # L: one wing away from the street
        return (front, BuildingPart(side, bar + wing / 2, bar, wing, lower))
    if kind == 2:  # U: a court open to the street
        wings = (BuildingPart(s, wing / 2, bar, wing, lower) for s in (-side, side))
        return (back, *wings)
    return (back, BuildingPart(0.0, wing / 2, bar, wing, lower))  # T: a wing towards the street


def _protrusion(
    walls: tuple[BuildingPart, ...], width: float, rng: np.random.Generator
) -> BuildingPart:
    length, depth = rng.uniform(1.0, 4.5), rng.uniform(0.6, 2.2)
    along = rng.uniform(-0.5, 0.5) * (width - length)
    fronts = [p for p in walls if p.faces_street_at(along)]
    wall = min(fronts, key=lambda p: p.away - p.depth / 2)
    surface = wall.away - wall.depth / 2
    height = rng.uniform(2.2, wall.height)
    return BuildingPart(along, surface - depth / 2, length, depth, height)

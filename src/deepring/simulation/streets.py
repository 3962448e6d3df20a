"""The street graph: a jittered grid of crossings in two parts, joined by one street."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.settings import SimulationSettings
from deepring.simulation.split import GAP

FloatArray = NDArray[np.float64]
Street = tuple[int, int]

_INSET = 10.0  # least distance of crossings next to the gap from the edge of their region


@dataclass(frozen=True, eq=False)
class Streets:
    """Crossings (n, 2) in world metres and the streets between them, as pairs of crossings.

    ``train`` and ``test`` list each part's streets; ``link`` is the one that crosses the gap,
    from its train to its test end. ``bends`` are the crossings at which one street only bends.
    """

    crossings: FloatArray
    train: tuple[Street, ...]
    test: tuple[Street, ...]
    link: Street
    bends: frozenset[int] = frozenset()

    @cached_property
    def all(self) -> tuple[Street, ...]:
        """Every street once."""
        return (*self.train, *self.test, self.link)

    def length(self, street: Street) -> float:
        """Distance between the ends (metres)."""
        return float(np.hypot(*(self.crossings[street[1]] - self.crossings[street[0]])))


def street_grid(settings: SimulationSettings, rng: np.random.Generator) -> Streets:
    """Draw crossings at random and connect neighbours within each part."""
    train_x = -_INSET - settings.block * np.arange(settings.train_columns)[::-1]
    test_x = GAP + _INSET + settings.block * np.arange(settings.test_columns)
    columns = np.concatenate([train_x, test_x])
    rows = settings.block * (np.arange(settings.rows) - (settings.rows - 1) / 2)
    grid = np.stack(np.meshgrid(columns, rows, indexing="ij"), axis=-1)
    grid = grid + rng.uniform(-1.0, 1.0, grid.shape) * settings.crossing_jitter
    split = settings.train_columns
    grid[split - 1, :, 0] = np.minimum(grid[split - 1, :, 0], -_INSET)
    grid[split, :, 0] = np.maximum(grid[split, :, 0], GAP + _INSET)

    middle = settings.rows // 2
    link = ((split - 1) * settings.rows + middle, split * settings.rows + middle)
    train = _neighbours(0, settings.train_columns, settings.rows)
    test = _neighbours(split, settings.test_columns, settings.rows)
    if settings.streets_missing > 0:
        train, test = (
            _thinned(part, settings.streets_missing, end, rng)
            for part, end in ((train, link[0]), (test, link[1]))
        )
    streets = Streets(grid.reshape(-1, 2), train, test, link)
    return _bent(streets, settings.street_bend, rng) if settings.street_bend > 0 else streets


def _thinned(
    part: tuple[Street, ...], share: float, end: int, rng: np.random.Generator
) -> tuple[Street, ...]:
    """A part without up to ``share`` of its streets, which leaves T junctions and larger blocks.

    Every crossing keeps two streets and a way to every other; ``end`` is where the link meets it.
    """
    kept = list(part)
    for number in rng.permutation(len(part)):
        rest = [street for street in kept if street != part[number]]
        meets = Counter(crossing for street in rest for crossing in street)
        few = min(meets[crossing] + (crossing == end) for street in part for crossing in street)
        if len(rest) >= (1 - share) * len(part) and few >= 2 and _connected(rest):
            kept = rest
    return tuple(kept)


def _connected(streets: Sequence[Street]) -> bool:
    """Whether the streets lead from each of their crossings to each other."""
    reached, waiting = {streets[0][0]}, [streets[0][0]]
    while waiting:
        here = waiting.pop()
        for a, b in streets:
            other = b if a == here else a
            if here in (a, b) and other not in reached:
                reached.add(other)
                waiting.append(other)
    return reached == {crossing for street in streets for crossing in street}


def _bent(streets: Streets, most: float, rng: np.random.Generator) -> Streets:
    """Every street but the link with its middle moved aside by up to ``most`` metres."""
    points = list(streets.crossings)

    def bend(street: Street) -> tuple[Street, Street]:
        start, end = points[street[0]], points[street[1]]
        aside = np.array([start[1] - end[1], end[0] - start[0]]) / streets.length(street)
        points.append((start + end) / 2 + rng.uniform(-most, most) * aside)
        return (street[0], len(points) - 1), (len(points) - 1, street[1])

    train = tuple(half for street in streets.train for half in bend(street))
    test = tuple(half for street in streets.test for half in bend(street))
    bends = frozenset(range(len(streets.crossings), len(points)))
    return replace(streets, crossings=np.array(points), train=train, test=test, bends=bends)


def _neighbours(first: int, columns: int, rows: int) -> tuple[Street, ...]:
    """Streets between adjacent crossings of the columns ``first`` .. ``first + columns - 1``."""
    index = (np.arange(columns)[:, None] + first) * rows + np.arange(rows)
    across = np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)
    along = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1)
    return tuple((int(a), int(b)) for a, b in np.concatenate([across, along]))


def clearance(points: FloatArray, streets: Streets, within: float = np.inf) -> FloatArray:
    """Distance from points (..., 2) to the nearest street's middle (metres).

    Distances of ``within`` and more may be larger than they are: streets farther than that from
    all points are left out.
    """
    best = np.full(points.shape[:-1], np.inf)
    if not best.size:
        return best
    centre = points.reshape(-1, 2).mean(axis=0)
    farthest = float(np.hypot(*(points - centre).reshape(-1, 2).T).max()) + within
    for a, b in streets.all:
        ends = streets.crossings[a], streets.crossings[b]
        if _from_street(centre, *ends) <= farthest:
            best = np.minimum(best, _from_street(points, *ends))
    return best


def _from_street(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distance (...) from points (..., 2) to the straight line from ``start`` to ``end``."""
    way = end - start
    share = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    gap = points - start - share[..., None] * way
    return np.hypot(gap[..., 0], gap[..., 1])

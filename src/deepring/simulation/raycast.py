"""Casts rays against upright prisms and the ground, by vertical columns of beams.

A world of upright prisms is 2.5-D: in the vertical plane of one azimuth every prism is a rectangle
from an entry to an exit distance and from bottom to top. Each pair of a prism and an azimuth needs
one test in the plane; only pairs that hit are expanded to the beams that they cover.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deepring.simulation.fan import Fan
from deepring.simulation.ground import Ground
from deepring.simulation.ground_profile import ground_distance
from deepring.simulation.shapes import Prisms

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Values of hits besides the index of a prism.
GROUND, NOTHING = -1, -2

_NEAREST = 1e-6  # distance at which a ceiling above the origin begins (metres)


@dataclass(frozen=True, eq=False)
class Pairs:
    """A prism seen in a column: indices, and entry and exit distance in the plane; all (n,)."""

    prism: IntArray
    column: IntArray
    entry: FloatArray
    exit: FloatArray

    def keep(self, index: NDArray) -> "Pairs":
        """The pairs that ``index`` selects."""
        parts = (self.prism, self.column, self.entry, self.exit)
        return Pairs(*(part[index] for part in parts))


def cast(
    fan: Fan,
    origin: FloatArray,
    prisms: Prisms,
    ground: Ground,
    max_range: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, IntArray]:
    """The first surface on each ray within ``max_range`` (metres) of ``origin`` (3,).

    Returns horizontal distances (C, B) in metres, inf without a hit, and hits (C, B): the index of
    a prism, GROUND or NOTHING. Prisms around the origin are ignored, except for opaque ones
    that hang above it. ``rng`` draws the depth of beams in crowns.
    """
    near = np.flatnonzero(
        np.hypot(prisms.x - origin[0], prisms.y - origin[1]) - prisms.reach < max_range
    )
    close = prisms[near]
    distance: FloatArray = ground_distance(fan, origin, ground, max_range).ravel()
    hit = np.where(np.isfinite(distance), GROUND, NOTHING)

    pairs = _cross(_candidates(fan, origin, close), fan, origin, close)
    first, last = _beams_covered(pairs, fan, origin[2], close)
    visible = _not_hidden(pairs, last, fan, origin[2], close) & (last > first)
    pairs, first, last = pairs.keep(visible), first[visible], last[visible]

    pair, ray = _spread(pairs, first, last, fan)
    reach = _surface_distance(pairs, pair, fan.slopes.ravel()[ray], origin[2], close, rng)
    np.minimum.at(distance, ray, reach)
    nearest = (reach == distance[ray]) & np.isfinite(reach)
    hit[ray[nearest]] = near[pairs.prism[pair[nearest]]]

    distance = distance.reshape(fan.slopes.shape)
    far = distance * np.sqrt(1 + fan.slopes**2) > max_range
    distance[far] = np.inf
    return distance, np.where(far, NOTHING, hit.reshape(fan.slopes.shape))


def _candidates(fan: Fan, origin: FloatArray, prisms: Prisms) -> tuple[IntArray, IntArray]:
    """Prism and column of every pair where the column may cross the footprint's circle."""
    dx, dy = prisms.x - origin[0], prisms.y - origin[1]
    distance = np.hypot(dx, dy)
    around = distance <= prisms.reach
    half = np.arcsin(np.where(around, 1.0, prisms.reach / np.maximum(distance, 1e-9)))
    half[around] = np.pi
    start = (np.arctan2(dy, dx) - half - fan.first) / fan.step
    begin = np.ceil(start).astype(np.int64)
    count = np.floor(start + 2 * half / fan.step).astype(np.int64) - begin + 1
    count = np.clip(count, 0, fan.around)
    if fan.whole:
        prism, offset = _ranges(count)
        return prism, (begin[prism] + offset) % fan.around
    return _within(begin % fan.around, count, fan)


def _within(begin: IntArray, count: IntArray, fan: Fan) -> tuple[IntArray, IntArray]:
    """Prism and column of the columns ``begin`` to ``begin + count`` that are in the sector.

    Columns from ``around`` on are in the next revolution, whose part of the sector counts as well.
    """
    columns = len(fan.slopes)
    starts = np.concatenate([begin, np.zeros_like(begin)])
    ends = np.concatenate([begin + count, begin + count - fan.around])
    prism, offset = _ranges(np.maximum(np.minimum(ends, columns) - starts, 0))
    return prism % len(begin), starts[prism] + offset


def _ranges(count: IntArray) -> tuple[IntArray, IntArray]:
    """Owner and running index of every item if owner i has ``count[i]`` items."""
    owner = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - before[owner]


def _cross(
    candidates: tuple[IntArray, IntArray], fan: Fan, origin: FloatArray, prisms: Prisms
) -> Pairs:
    """The pairs that cross, with entry and exit, without prisms around the origin.

    A ceiling above the origin is entered at once.
    """
    prism, column = candidates
    dx, dy = (prisms.x - origin[0])[prism], (prisms.y - origin[1])[prism]
    c, s = np.cos(fan.headings)[column], np.sin(fan.headings)[column]
    entry, leave = np.empty(len(prism)), np.empty(len(prism))
    disc = prisms.round[prism]
    box = ~disc

    along = dx[disc] * c[disc] + dy[disc] * s[disc]
    across = dx[disc] * s[disc] - dy[disc] * c[disc]
    chord = np.sqrt(np.maximum(prisms.half_length[prism[disc]] ** 2 - across**2, 0.0))
    entry[disc], leave[disc] = along - chord, along + chord

    owner = prism[box]
    turn_c, turn_s = np.cos(prisms.yaw)[owner], np.sin(prisms.yaw)[owner]
    spans = []
    for axis_x, axis_y, half in (
        (turn_c, turn_s, prisms.half_length[owner]),
        (-turn_s, turn_c, prisms.half_width[owner]),
    ):
        centre = dx[box] * axis_x + dy[box] * axis_y
        speed = c[box] * axis_x + s[box] * axis_y
        speed = np.where(np.abs(speed) < 1e-12, 1e-12, speed)
        reach = half / np.abs(speed)
        spans.append((centre / speed - reach, centre / speed + reach))
    entry[box] = np.maximum(spans[0][0], spans[1][0])
    leave[box] = np.minimum(spans[0][1], spans[1][1])

    ceiling = (prisms.z0 > origin[2]) & (prisms.depth == 0)
    entry = np.where(ceiling[prism], np.maximum(entry, _NEAREST), entry)
    crossing = (entry > 0) & (leave > entry)
    return Pairs(prism, column, entry, leave).keep(crossing)


def _beams_covered(
    pairs: Pairs, fan: Fan, height: float, prisms: Prisms
) -> tuple[IntArray, IntArray]:
    """First and one-past-last beam that meet the side, top or bottom of each pair's prism."""
    bottom, top = prisms.z0[pairs.prism] - height, prisms.z1[pairs.prism] - height
    low = bottom / np.where(bottom > 0, pairs.exit, pairs.entry)
    high = top / np.where(top > 0, pairs.entry, pairs.exit)
    lift = 100.0 * np.arange(len(fan.slopes))
    table = (fan.slopes + lift[:, None]).ravel()
    base, beams = lift[pairs.column], fan.slopes.shape[1]
    first = np.searchsorted(table, np.clip(low, -40, 40) + base) - beams * pairs.column
    last = np.searchsorted(table, np.clip(high, -40, 40) + base, "right") - beams * pairs.column
    return first, last


def _not_hidden(
    pairs: Pairs, last: IntArray, fan: Fan, height: float, prisms: Prisms
) -> NDArray[np.bool_]:
    """Whether no taller opaque wall hides a pair in its column (exact, only a speed-up).

    A standing wall higher than the sensor covers every beam from the ground up to its ``last``;
    prisms that begin behind it and are not higher are invisible.
    """
    columns, beams = fan.slopes.shape
    wall = prisms.grounded[pairs.prism] & (prisms.z1[pairs.prism] > height)
    nearest = np.full(columns * (beams + 1), np.inf)
    cell = pairs.column * (beams + 1) + last
    np.minimum.at(nearest, cell[wall], pairs.entry[wall])
    from_above = np.minimum.accumulate(nearest.reshape(columns, -1)[:, ::-1], axis=1)[:, ::-1]
    hidden: NDArray[np.bool_] = pairs.entry > from_above.ravel()[cell]
    return ~hidden


def _spread(pairs: Pairs, first: IntArray, last: IntArray, fan: Fan) -> tuple[IntArray, IntArray]:
    """Pair and flat ray index of every beam that a pair covers."""
    pair, offset = _ranges(last - first)
    ray = (pairs.column * fan.slopes.shape[1] + first)[pair] + offset
    return pair, ray


def _surface_distance(
    pairs: Pairs,
    pair: IntArray,
    slope: FloatArray,
    height: float,
    prisms: Prisms,
    rng: np.random.Generator,
) -> FloatArray:
    """Horizontal distance at which each ray meets its prism's surface, or stops in its crown."""
    prism = pairs.prism[pair]
    bottom, top = prisms.z0[prism] - height, prisms.z1[prism] - height
    entry, leave = pairs.entry[pair], pairs.exit[pair]
    slope = np.where(np.abs(slope) < 1e-9, 1e-9, slope)
    at_bottom, at_top = bottom / slope, top / slope
    distance = np.maximum(entry, np.minimum(at_bottom, at_top))

    crown = np.flatnonzero(prisms.depth[prism] > 0)
    rise = np.sqrt(1 + slope[crown] ** 2)
    inside = rng.exponential(size=len(crown)) * prisms.depth[prism[crown]] / rise
    end = np.minimum(leave[crown], np.maximum(at_bottom, at_top)[crown])
    stop = distance[crown] + inside
    distance[crown] = np.where(stop < end, stop, np.inf)
    return distance

"""Pairs of neighbouring scans, overlaid by their poses and as they fit best."""

import math
from typing import NamedTuple

import numpy as np

from deepring.data.inspection.registration import (
    Planar,
    Registration,
    fit_of,
    planar_between,
    register,
    standing_cells,
)
from deepring.data.session import Session
from deepring.errors import BrokenScanError

#: Metres between the two scans of a pair: apart enough to tell a motion from standing still, and
#: near enough to see the same. Scans between them, at most.
APART, FARTHEST, MOST_BETWEEN = 6.0, 20.0, 20
#: Cells that stand out, fewer of which show too little to compare.
FEWEST_CELLS = 40
#: Metres, metres per metre of motion, and degrees: a pair contradicts its poses if it fits better
#: so far away. Of 1310 pairs of good drives one is 2.0 m off after 14.7 m, the others up to 1.2 m
#: and 4.2°.
FAR, FAR_PER_METRE, TURNED = 1.5, 0.05, 8.0
#: Share of fit: so little as given, and so much more as found. By wrong poses 0.1 to 0.7 fits, as
#: found 0.6 to 1. In the corridors of a building 0.74 and more fits wherever scans are put.
WELL, BETTER = 0.73, 0.12
#: Score and fit of a pair that resembles nothing are lower: two unrelated scans have up to 0.1 and
#: 0.5, and of the good pairs one had less than 0.15. Inside a building the score is low and the fit
#: high, since a ceiling stands out everywhere.
CHANCE, CHANCE_FIT = 0.15, 0.6


class Overlay(NamedTuple):
    """A pair of scans: its pose by the session's poses, and the one that fits best."""

    first: int
    second: int
    given: Planar
    best: Registration
    fit: float
    """Share of what stands out in the second scan that lies on the first, as given."""
    fit_found: float
    """The same share as found."""

    @property
    def found(self) -> Planar:
        """The pose that fits best."""
        return self.best.found

    @property
    def clear(self) -> bool:
        """Whether nothing else fits nearly as well."""
        return self.best.clear

    @property
    def wrong(self) -> bool:
        """Whether it contradicts the poses."""
        better = self.fit < WELL and self.fit_found > self.fit + BETTER
        return self.clear and better and not near(self.given, self.found)

    @property
    def right(self) -> bool:
        """Whether it fits best as the poses say."""
        return self.clear and near(self.given, self.found)

    @property
    def lost(self) -> bool:
        """Whether it resembles nothing."""
        return not self.clear and self.best.given_score < CHANCE and self.fit < CHANCE_FIT


def near(pose: Planar, found: Planar) -> bool:
    """Whether two poses of a pair are the same within the accuracy of the comparison."""
    far = FAR + FAR_PER_METRE * math.hypot(found.x, found.y)
    return pose.distance(found) <= far and pose.turn(found) <= TURNED


def neighbours(session: Session, count: int) -> tuple[list[tuple[int, int]], float]:
    """Up to ``count`` pairs of scans near each other, and the median distance in metres.

    One half of the pairs are those between which the poses turn most, the other half is spread
    over the drive. Without any pair near enough, the list is empty.
    """
    positions = session.positions
    n = len(session)
    pairs, distances = [], []
    for first in np.unique(np.linspace(0, n - 2, min(n - 1, 400)).astype(int)).tolist():
        ahead = positions[first + 1 : first + 1 + MOST_BETWEEN] - positions[first]
        away = np.hypot(ahead[:, 0], ahead[:, 1])
        reached = np.flatnonzero(away >= APART)
        step = int(reached[0]) if len(reached) else len(away) - 1
        if away[step] > FARTHEST and step > 0:
            step -= 1
        distances.append(float(away[step]))
        if away[step] <= FARTHEST:
            pairs.append((first, first + 1 + step))
    typical = float(np.median(distances)) if distances else 0.0
    yaw = np.arctan2(session.poses[:, 1, 0], session.poses[:, 0, 0])
    turns = {p: abs(math.remainder(yaw[p[1]] - yaw[p[0]], 2 * math.pi)) for p in pairs}
    chosen: list[tuple[int, int]] = []
    for pair in sorted(pairs, key=lambda p: -turns[p]):
        if len(chosen) < count // 2 and all(_apart(pair, other) for other in chosen):
            chosen.append(pair)
    rest = [pair for pair in pairs if all(_apart(pair, other) for other in chosen)]
    picks = np.linspace(0, len(rest) - 1, min(len(rest), count - len(chosen))).astype(int)
    return sorted({*chosen, *(rest[k] for k in picks)}), typical


def _apart(pair: tuple[int, int], other: tuple[int, int]) -> bool:
    return pair[1] <= other[0] or other[1] <= pair[0]


def overlay(session: Session, first: int, second: int) -> Overlay | None:
    """Compare two scans; None if one is broken or shows too little."""
    try:
        a, b = (standing_cells(session.points(k), session.poses[k]) for k in (first, second))
    except BrokenScanError:
        return None
    if min(len(a), len(b)) < FEWEST_CELLS:
        return None
    given = planar_between(session.poses[first], session.poses[second])
    best = register(a, b, given)
    fits = fit_of(a, b, given), fit_of(a, b, best.found)
    return Overlay(first, second, given, best, *fits)

"""Whether neighbouring scans fit on each other by the poses of their session."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.finding import Finding
from deepring.data.inspection.motion import inverse_poses, opposite_turns
from deepring.data.inspection.registration import (
    Planar,
    fit_of,
    planar_between,
    register,
    standing_cells,
)
from deepring.data.session import Session
from deepring.errors import BrokenScanError

#: Pairs that are compared, 20 to 40 ms each besides reading.
PAIRS = 8
#: Metres between the two scans of a pair: apart enough to tell a motion from standing still, and
#: near enough to see the same. Scans between them, at most.
APART, FARTHEST, MOST_BETWEEN = 6.0, 20.0, 20
#: Cells that stand out, fewer of which show too little to compare.
FEWEST_CELLS = 40
#: Metres, metres per metre of motion, degrees, and share of fit: a pair contradicts its poses if it
#: fits better by so much, so far away. Of 1260 pairs of good drives one is 2.0 m off after 14.7 m,
#: the others up to 1.1 m and 4.2°.
FAR, FAR_PER_METRE, TURNED, BETTER = 1.5, 0.05, 8.0, 0.05
#: Score and fit of a pair that resembles nothing are lower: two unrelated scans have up to 0.1 and
#: 0.5, and of the good pairs one had less than 0.15. Inside a building the score is low and the fit
#: high, since a ceiling stands out everywhere.
CHANCE, CHANCE_FIT = 0.15, 0.6
#: Shares of the pairs: that resemble nothing, for a doubt; that another reading must explain, to be
#: named.
LOST, EXPLAINED = 0.75, 0.8
#: Degrees, median, of scans whose level is not that of the ground.
MOST_TILT = 35.0
#: Scans by which poses are shifted to see if they fit then.
SHIFTS = 40


class Overlay(NamedTuple):
    """A pair of scans: its pose by the session's poses, and the one that fits best."""

    first: int
    second: int
    given: Planar
    found: Planar
    clear: bool
    """Whether nothing else fits nearly as well as ``found``."""
    score: float
    """Correlation as given, see `register`."""
    fit: float
    """Share of what stands out in the second scan that lies on the first, as given."""
    fit_found: float
    """The same share as found."""

    @property
    def wrong(self) -> bool:
        """Whether it contradicts the poses."""
        better = self.fit_found > self.fit + BETTER
        return self.clear and better and not near(self.given, self.found)

    @property
    def lost(self) -> bool:
        """Whether it resembles nothing."""
        return not self.clear and self.score < CHANCE and self.fit < CHANCE_FIT


class OverlayCheck(NamedTuple):
    """Findings, and what was compared or why nothing could be."""

    findings: list[Finding]
    summary: str
    """What was compared, with figures, or 'not compared: ...' with the reason."""


def near(pose: Planar, found: Planar) -> bool:
    """Whether two poses of a pair are the same within the accuracy of the comparison."""
    far = FAR + FAR_PER_METRE * math.hypot(found.x, found.y)
    return pose.distance(found) <= far and pose.turn(found) <= TURNED


def check_overlays(session: Session) -> OverlayCheck:
    """Overlay a few pairs of neighbouring scans as their poses say, and as they fit best.

    Reads up to 16 scans, and some more if one pair contradicts the poses.
    """
    if not len(session):
        return OverlayCheck([], "not compared: no scan")
    tilt = math.degrees(math.acos(np.clip(np.median(session.poses[:, 2, 2]), -1, 1)))
    if tilt > MOST_TILT:
        return OverlayCheck([], f"not compared: scans are tilted by {tilt:.0f}°")
    pairs, typical = neighbours(session, PAIRS)
    if not pairs:
        reason = f"neighbouring scans are {typical:.0f} m apart" if len(session) > 1 else "one scan"
        return OverlayCheck([], f"not compared: {reason}")
    overlays = _overlays(session, pairs)
    if sum(o.wrong for o in overlays) == 1:
        # One may be a chance: those around it decide.
        [wrong] = [o for o in overlays if o.wrong]
        overlays += _overlays(session, _around(wrong, len(session), pairs))
    if not overlays:
        return OverlayCheck([], "not compared: too little stands out of the ground")
    clear = [o for o in overlays if o.clear]
    wrong_ones = [o for o in clear if o.wrong]
    if len(wrong_ones) > 1 or (wrong_ones and len(wrong_ones) == len(clear)):
        finding = _contradiction(session, clear, wrong_ones)
        return OverlayCheck([finding], finding.found)
    lost = [o for o in overlays if o.lost]
    if len(lost) >= max(2.0, LOST * len(overlays)):
        finding = Finding(
            "poses",
            f"{len(lost)} of {len(overlays)} pairs of scans, some {typical:.0f} m apart by the "
            "poses, do not resemble each other in any position",
            "check that scans and poses are of one drive and in one order",
        )
        return OverlayCheck([finding], finding.found)
    if not clear:
        return OverlayCheck([], "not compared: scans look the same along the path")
    fit = float(np.median([o.fit for o in clear]))
    return OverlayCheck(
        [],
        f"{len(clear)} of {len(overlays)} pairs of neighbouring scans fit by their poses "
        f"({fit:.2f} of what stands out)",
    )


def _contradiction(session: Session, clear: list[Overlay], wrong: list[Overlay]) -> Finding:
    worst = max(wrong, key=lambda o: o.fit_found - o.fit)
    given, found = worst.given, worst.found
    text = (
        f"{len(wrong)} of {len(clear)} pairs of neighbouring scans contradict them: from "
        f"{session.files[worst.first].name} to {session.files[worst.second].name} {_motion(given)} "
        f"by the poses, {_motion(found)} as the scans fit best ({worst.fit:.2f} of what stands out "
        f"fits by the poses, {worst.fit_found:.2f} so)"
    )
    advice = _advice(session, clear, wrong)
    return Finding("poses", text, advice)


def _advice(session: Session, clear: list[Overlay], wrong: list[Overlay]) -> str:
    """The readings that explain the pairs; else the shift between poses and scans that does."""
    fitting = [r for r in _readings(session, clear) if _explained(r.read, clear, wrong)]
    if not fitting and len(clear) >= 4:
        shifts = [shift for shift in _shifts(session) if _explained(shift.read, clear, wrong)]
        fitting = sorted(shifts, key=lambda r: -_explained(r.read, clear, wrong))[:1]
    if not fitting:
        return (
            "check that scans and poses are of one drive, in one order and at the same times, and "
            "the pose of the LiDAR in their frame"
        )
    names = ", or ".join(reading.name for reading in fitting)
    return f"with {names}, they fit: {'; or '.join(reading.advice for reading in fitting)}"


def _motion(pose: Planar) -> str:
    turn = round(math.degrees(pose.yaw))
    side = f", turned by {turn}°" if turn else ""
    return f"{pose.x:.1f} m forward and {pose.y:.1f} m left{side}"


class _Reading(NamedTuple):
    name: str
    advice: str
    read: Callable[[Overlay], Planar]


def _explained(
    read: Callable[[Overlay], Planar], clear: list[Overlay], wrong: list[Overlay]
) -> float:
    """Share of the pairs with which a reading agrees, 0 unless with most, also of the wrong."""
    agree = [near(read(o), o.found) for o in clear]
    of_wrong = [near(read(o), o.found) for o in wrong]
    most = min(sum(agree) / len(agree), sum(of_wrong) / len(of_wrong)) >= EXPLAINED
    return sum(agree) / len(agree) if most else 0.0


def _readings(session: Session, clear: list[Overlay]) -> Iterator[_Reading]:
    """Other ways to read the poses."""
    poses = session.poses

    def of(change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Any:
        return lambda o: planar_between(*change(poses[[o.first, o.second]]))

    def swapped(pair: NDArray[np.float64]) -> NDArray[np.float64]:
        pair = pair.copy()
        pair[:, [0, 1], 3] = pair[:, [1, 0], 3]
        return pair

    yield _Reading(
        "inverse poses", "expected are those of the scans in the world", of(inverse_poses)
    )
    yield _Reading("inverse rotations", "the yaw has the wrong sign", of(opposite_turns))
    yield _Reading(
        "y and yaw of the other sign",
        "y of the world or of the scans is mirrored: expected are right-handed frames, z up",
        lambda o: Planar(o.given.x, -o.given.y, -o.given.yaw),
    )
    turn = _mount(clear)
    if abs(math.degrees(turn)) > TURNED:
        c, s = math.cos(turn), math.sin(turn)
        yield _Reading(
            f"scans turned by {math.degrees(turn):.0f}°",
            "the rotation of the LiDAR in the poses' frame is missing or wrong (KITTI: Tr in "
            "calib.txt; MulRan: extrinsic; custom drives: sensor_in_body)",
            lambda o: Planar(
                c * o.given.x - s * o.given.y, s * o.given.x + c * o.given.y, o.given.yaw
            ),
        )
    yield _Reading("x and y swapped", "swap x and y of the positions back", of(swapped))
    scale = _scale(clear)
    if scale is not None:
        yield _Reading(
            f"positions times {scale:.3g}",
            "the unit of the positions is not metres",
            lambda o: Planar(scale * o.given.x, scale * o.given.y, o.given.yaw),
        )
    last = len(poses) - 1
    yield _Reading(
        "poses in reverse order",
        "expected is the order of the scans",
        lambda o: planar_between(poses[last - o.first], poses[last - o.second]),
    )


def _shifts(session: Session) -> Iterator[_Reading]:
    """The poses of scans before and after, the nearest first."""
    poses = session.poses

    def of(by: int) -> Any:
        last = len(poses) - 1
        return lambda o: planar_between(*poses[np.clip([o.first + by, o.second + by], 0, last)])

    advice = "scans and poses are shifted against each other: check stamps and counts"
    for by in range(1, SHIFTS + 1):
        yield _Reading(f"the poses of other scans, e.g. {by} later", advice, of(by))
        yield _Reading(f"the poses of other scans, e.g. {by} earlier", advice, of(-by))


def _mount(clear: list[Overlay]) -> float:
    """Turn in radians from the given directions of motion to those found."""
    total = sum(complex(o.found.x, o.found.y) * complex(o.given.x, -o.given.y) for o in clear)
    return math.atan2(total.imag, total.real) if total else 0.0


def _scale(clear: list[Overlay]) -> float | None:
    """Length found for each metre given; None without motion."""
    given = sum(math.hypot(o.given.x, o.given.y) for o in clear)
    found = sum(math.hypot(o.found.x, o.found.y) for o in clear)
    return found / given if given > 0 and found > 0 else None


def _overlays(session: Session, pairs: list[tuple[int, int]]) -> list[Overlay]:
    found = (overlay(session, *pair) for pair in pairs)
    return [o for o in found if o is not None]


def _around(wrong: Overlay, scans: int, known: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Other pairs that span the same place."""
    first, second = wrong.first, wrong.second
    pairs = [(first - 1, second), (first, second + 1), (first - 1, second + 1)]
    return [p for p in pairs if p[0] >= 0 and p[1] < scans and p not in known]


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
    found, clear, score = register(a, b, given)
    return Overlay(
        first, second, given, found, clear, score, fit_of(a, b, given), fit_of(a, b, found)
    )

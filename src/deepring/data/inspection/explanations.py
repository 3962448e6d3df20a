"""Which other reading of the poses explains how pairs of scans fit."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.inspection.motion import inverse_poses, opposite_turns
from deepring.data.inspection.registration import Planar, planar_between
from deepring.data.inspection.scan_pairs import TURNED, Overlay, near
from deepring.data.session import Session

#: Share of the pairs that a reading must explain to be named.
EXPLAINED = 0.8
#: Scans by which poses are shifted to see if they fit then.
SHIFTS = 40


def explanation(session: Session, clear: list[Overlay], wrong: list[Overlay]) -> str:
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

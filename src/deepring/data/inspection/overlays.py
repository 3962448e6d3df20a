"""Whether neighbouring scans fit on each other by the poses of their session."""

import math
from typing import NamedTuple

import numpy as np

from deepring.data.inspection.explanations import explanation
from deepring.data.inspection.finding import Finding
from deepring.data.inspection.motion import axis_problems, measurable, measure_motion
from deepring.data.inspection.registration import Planar
from deepring.data.inspection.scan_pairs import Overlay, neighbours, overlay
from deepring.data.session import Session

#: Pairs that are compared, 20 to 40 ms each besides reading.
PAIRS = 8
#: Share of the pairs that resemble nothing, for a doubt.
LOST = 0.75
#: Metres found for each metre given are 1 to within the first, in median of the second many clear
#: pairs that are the third many metres apart: 0.977 to 0.999 in 21 parts of good drives, real and
#: simulated, single pairs 0.87 to 1.04.
SCALED, SCALED_PAIRS, SCALED_APART = 0.06, 4, 4.0


class OverlayCheck(NamedTuple):
    """Findings, and what was compared or why nothing could be."""

    findings: list[Finding]
    summary: str
    """What was compared, with figures, or 'not compared: ...' with the reason."""


def check_overlays(session: Session) -> OverlayCheck:
    """Overlay a few pairs of neighbouring scans as their poses say, and as they fit best.

    Reads up to 16 scans, and some more if one pair contradicts the poses.
    """
    if not len(session):
        return OverlayCheck([], "not compared: no scan")
    if not measurable(session.poses):
        return OverlayCheck([], "not compared: poses are not rigid")
    problems = axis_problems(measure_motion(session.poses))
    if problems:
        return OverlayCheck([], f"not compared: {problems[0][1]}")
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
    if (scaled := _scaled(clear)) is not None:
        return OverlayCheck([scaled], scaled.found)
    right = [o for o in clear if o.right]
    if not right:
        return OverlayCheck([], "not compared: scans look the same along the path")
    fit = float(np.median([o.fit for o in right]))
    return OverlayCheck(
        [],
        f"{len(right)} of {len(overlays)} pairs of neighbouring scans fit by their poses "
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
    advice = explanation(session, clear, wrong)
    return Finding("poses", text, advice)


def _scaled(clear: list[Overlay]) -> Finding | None:
    """Positions that are all too near to each other or too far, by a little: of another scale."""
    lengths = [(math.hypot(*o.given[:2]), math.hypot(*o.found[:2])) for o in clear]
    ratios = np.array([found / given for given, found in lengths if given >= SCALED_APART])
    if len(ratios) < SCALED_PAIRS:
        return None
    scale = float(np.median(ratios))
    one_sided = np.mean((ratios > 1) == (scale > 1)) >= LOST
    if abs(scale - 1) <= SCALED or not one_sided:
        return None
    return Finding(
        "poses",
        f"{len(ratios)} pairs of neighbouring scans fit best {scale:.2f} times as far apart as "
        "they are by the poses (median), expected 1.00",
        f"check the scale of the poses: times {scale:.2f} they would fit",
    )


def _motion(pose: Planar) -> str:
    turn = round(math.degrees(pose.yaw))
    side = f", turned by {turn}°" if turn else ""
    return f"{pose.x:.1f} m forward and {pose.y:.1f} m left{side}"


def _overlays(session: Session, pairs: list[tuple[int, int]]) -> list[Overlay]:
    found = (overlay(session, *pair) for pair in pairs)
    return [o for o in found if o is not None]


def _around(wrong: Overlay, scans: int, known: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Other pairs that span the same place."""
    first, second = wrong.first, wrong.second
    pairs = [(first - 1, second), (first, second + 1), (first - 1, second + 1)]
    return [p for p in pairs if p[0] >= 0 and p[1] < scans and p not in known]

"""Checks a dataset: reads every scan once, reports what each session holds and what is doubtful."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from deepring.checks import one_of
from deepring.data.inspection.figures import ScanFigures, measure_scan
from deepring.data.inspection.finding import Finding
from deepring.data.inspection.overlays import check_overlays
from deepring.data.inspection.poses import pose_findings
from deepring.data.inspection.scans import shows_ground
from deepring.data.inspection.session import file_findings
from deepring.data.inspection.session_scans import (
    crops,
    measured_findings,
    records_of,
    repeated_findings,
    usual_figures,
)
from deepring.data.poses.stamps import NANOSECONDS
from deepring.data.readers import detect_format, ground_of, list_sessions, open_session
from deepring.data.scans.returns import scan_from
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DataError, DeepringError
from deepring.progress import Progress

TIME_GAP_S = 1.0  # scans come at 5 to 10 Hz
JUMP_M = 10.0  # between consecutive scans

Verdict = Literal["good", "doubtful", "unusable"]


@dataclass(frozen=True)
class Gaps:
    """Steps between consecutive scans that exceed a limit."""

    count: int = 0
    largest: float = 0.0  # in seconds or metres; 0 without any


@dataclass(frozen=True)
class SessionReport:
    """The result of checking one session.

    ``scans`` excludes scans without a pose or with an impossible size, and includes those that
    failed to decode.
    """

    name: str
    format: str
    scans: int = 0  # with a pose and a possible file size
    readable: int = 0  # of these, those decoded without error
    without_pose: int = 0
    bad_poses: int = 0  # pose rows dropped or out of place
    broken: tuple[str, ...] = ()  # every unusable file with its reason
    span_s: float | None = None  # first to last scan; None without time stamps
    path_m: float = 0.0  # sum of the planar steps between scans
    time_gaps: Gaps | None = None  # steps > 1 s; None without time stamps
    repeated_stamps: int | None = None  # equal to the one before; None without time stamps
    jumps: Gaps = Gaps()  # steps > 10 m
    points: tuple[int, float, int] | None = None  # minimum, median, maximum per readable scan
    figures: ScanFigures | None = None  # medians over the readable scans
    ground_z: float | None = None  # where the ground should be, if that is known
    overlay: str = ""  # whether neighbouring scans fit on each other by their poses
    findings: tuple[Finding, ...] = ()
    problem: str | None = None  # why the session cannot be opened at all

    @property
    def verdict(self) -> Verdict:
        """The worst of what was found."""
        if self.problem is not None or any(finding.unusable for finding in self.findings):
            return "unusable"
        return "doubtful" if self.findings else "good"

    @property
    def ground_found(self) -> float | None:
        """z of the ground in most scans, metres; None where it is not clearly seen."""
        wrong = any(finding.unusable and finding.subject == "scans" for finding in self.findings)
        if self.figures is None or wrong or not shows_ground(self.figures):
            return None
        return self.figures.ground


def check(
    root: Path | str,
    format: str | None = None,
    session: str | None = None,
    progress: Progress | None = None,
) -> list[SessionReport]:
    """Read every scan in ``root``, one in memory at a time, and report on each session.

    With None, ``format`` is detected from the folder. ``session`` limits the check to one session.
    ``progress`` is called after each scan with the numbers of scans read and in the session. A
    session that cannot be opened gets a report with its ``problem``. Raises DataError for a folder
    without sessions, and ConfigError for an unknown format or session.
    """
    format = format or detect_format(root)
    names = list_sessions(format, root)
    if session is not None:
        one_of("session", session, names)
    return [
        _check_session(format, root, name, progress)
        for name in (names if session is None else [session])
    ]


def _check_session(
    format: str, root: Path | str, name: str, progress: Progress | None
) -> SessionReport:
    try:
        session = open_session(format, root, name)
    except DeepringError as error:
        return SessionReport(name=name, format=format, problem=str(error))
    measured, counts, unreadable = _read_all(session, progress)
    ground_z = _ground(session, format)
    findings = [
        *file_findings(session, tuple(unreadable)),
        *measured_findings(session, measured, ground_z),
        *repeated_findings(session, range(len(session))),
        *pose_findings(session),
    ]
    overlay = ""
    if not any(finding.unusable and finding.subject == "scans" for finding in findings):
        overlays = check_overlays(session)
        overlay = overlays.summary
        findings += overlays.findings
    steps_m = np.linalg.norm(np.diff(session.positions, axis=0), axis=1)
    span, time_gaps, repeated = None, None, None
    if session.stamps is not None and len(session):
        span = float(session.stamps[-1] - session.stamps[0]) / NANOSECONDS
        time_gaps = _gaps(np.diff(session.stamps) / NANOSECONDS, TIME_GAP_S)
        repeated = int(np.count_nonzero(np.diff(session.stamps) == 0))
    return SessionReport(
        name=name,
        format=format,
        scans=len(session),
        readable=len(measured),
        without_pose=session.skipped.without_pose,
        bad_poses=session.skipped.bad_poses,
        broken=session.skipped.broken + tuple(unreadable),
        span_s=span,
        path_m=float(steps_m.sum()),
        time_gaps=time_gaps,
        repeated_stamps=repeated,
        jumps=_gaps(steps_m, JUMP_M),
        points=(min(counts), float(np.median(counts)), max(counts)) if counts else None,
        figures=usual_figures(list(measured.values())) if measured else None,
        ground_z=ground_z,
        overlay=overlay,
        findings=tuple(findings),
    )


def _ground(session: Session, format: str) -> float | None:
    try:
        return ground_of(session, format)
    except DataError:
        return None


def _read_all(
    session: Session, progress: Progress | None
) -> tuple[dict[int, ScanFigures], list[int], list[str]]:
    """Figures of each readable scan by its index, their numbers of points, and broken scans.

    Figures are of scans before any crop of the session, numbers of points after it.
    """
    measured: dict[int, ScanFigures] = {}
    counts: list[int] = []
    broken: list[str] = []
    cropped = crops(session)
    for index, file in enumerate(session.files):
        try:
            records = records_of(session, index)
            scan = session.scan(index) if cropped else scan_from(records, file)
            measured[index] = measure_scan(records)
            counts.append(len(scan.points))
        except BrokenScanError as error:
            broken.append(str(error))
        if progress is not None:
            progress(index + 1, len(session))
    return measured, counts, broken


def _gaps(steps: np.ndarray, limit: float) -> Gaps:
    beyond = steps[steps > limit]
    return Gaps(len(beyond), float(beyond.max())) if len(beyond) else Gaps()

"""Checks a dataset: reads every scan once and reports on each session."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deepring.checks import one_of
from deepring.data.poses.stamps import NANOSECONDS
from deepring.data.readers import detect_format, list_sessions, open_session
from deepring.data.session import Session
from deepring.errors import BrokenScanError, DeepringError
from deepring.progress import Progress

TIME_GAP_S = 1.0  # scans come at 5 to 10 Hz
JUMP_M = 10.0  # between consecutive scans


@dataclass(frozen=True)
class _Gaps:
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
    time_gaps: _Gaps | None = None  # steps > 1 s; None without time stamps
    jumps: _Gaps = _Gaps()  # steps > 10 m
    points: tuple[int, float, int] | None = None  # minimum, median, maximum per readable scan
    problem: str | None = None  # why the session cannot be opened at all

    @property
    def usable(self) -> bool:
        """True if at least one scan has a pose and can be read."""
        return self.readable > 0


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
    counts, unreadable = _read_all(session, progress)
    steps_m = np.linalg.norm(np.diff(session.positions, axis=0), axis=1)
    span, time_gaps = None, None
    if session.stamps is not None:
        span = float(session.stamps[-1] - session.stamps[0]) / NANOSECONDS
        time_gaps = _gaps(np.diff(session.stamps) / NANOSECONDS, TIME_GAP_S)
    return SessionReport(
        name=name,
        format=format,
        scans=len(session),
        readable=len(counts),
        without_pose=session.skipped.without_pose,
        bad_poses=session.skipped.bad_poses,
        broken=session.skipped.broken + tuple(unreadable),
        span_s=span,
        path_m=float(steps_m.sum()),
        time_gaps=time_gaps,
        jumps=_gaps(steps_m, JUMP_M),
        points=(min(counts), float(np.median(counts)), max(counts)) if counts else None,
    )


def _read_all(session: Session, progress: Progress | None) -> tuple[list[int], list[str]]:
    """The number of points of each readable scan, and the reason for each other scan."""
    counts: list[int] = []
    broken: list[str] = []
    for index in range(len(session)):
        try:
            counts.append(len(session.points(index)))
        except BrokenScanError as error:
            broken.append(str(error))
        if progress is not None:
            progress(index + 1, len(session))
    return counts, broken


def _gaps(steps: np.ndarray, limit: float) -> _Gaps:
    beyond = steps[steps > limit]
    return _Gaps(len(beyond), float(beyond.max())) if len(beyond) else _Gaps()

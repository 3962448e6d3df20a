"""Scans that a piece of work leaves out because they cannot be used: counted, said, and too many
of them an error."""

import logging
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from deepring.data.session import Session
from deepring.data.spacing import sample_by_distance
from deepring.errors import BrokenScanError, DataError
from deepring.progress import Progress
from deepring.text import printable

T = TypeVar("T")

log = logging.getLogger(__name__)

#: Largest share of the scans of one piece of work that may be left out; a single one always may.
MOST = 0.2


class LeftOut:
    """The scans that cannot be used, each with its reason.

    Args:
        what: name of the scans in messages.
        total: number of scans that are wanted.
    """

    def __init__(self, what: str = "scans", total: int = 0) -> None:
        self.what, self.total = what, total
        self.reasons: list[str] = []
        self.missed = 0
        """Of the scans that are wanted; the others were tried in place of one of these."""
        self.without_pose = 0
        """Further scans, which nothing was made of since poses by stamps do not reach them."""

    def __len__(self) -> int:
        return len(self.reasons)

    def __str__(self) -> str:
        """One line, empty if nothing is left out."""
        if not self.reasons:
            return ""
        tried = len(self) - self.missed
        others = f", and {tried} near by, tried in their place" if tried else ""
        return printable(
            f"{self.what}: left out {self.missed} of {self.total} scans that cannot be used"
            f"{others}; first: {self.reasons[0]}"
        )

    def add(self, reason: str, *, instead: bool = False) -> None:
        """Leave out one scan, ``instead`` if it was tried in place of one that is left out.

        Raises DataError if more than `MOST` of the wanted ones, and more than one, are left out.
        """
        self.reasons.append(reason)
        self.missed += not instead
        if self.missed > max(1, MOST * self.total):
            raise DataError(
                f"{self.what}: {self.missed} or more of {self.total} scans cannot be used, "
                f"expected at most {MOST:.0%}; first: {self.reasons[0]}"
            )


def usable_scans(
    session: Session,
    spacing: float,
    use: Callable[[int], T],
    left_out: LeftOut | None = None,
    progress: Progress | None = None,
) -> Iterator[tuple[int, T]]:
    """Scans of a session at a spacing, as `sample_by_distance` selects them, and what is made of
    each; in place of a scan that cannot be used comes the next that can.

    Args:
        session: the scans.
        spacing: metres; 0 takes all.
        use: makes something of the scan with this index; raises BrokenScanError if it cannot.
        left_out: receives the scans that are left out, for a caller that says them; with None they
            are logged.
        progress: called with the numbers of scans done and wanted.

    Raises:
        ConfigError: a negative spacing.
        DataError: no scan can be used, or too many cannot; see `LeftOut.add`.
    """
    every = np.ones(len(session), dtype=np.bool_)
    counted = LeftOut() if left_out is None else left_out
    counted.what = f"session {session.name}"
    counted.total = len(sample_by_distance(session.positions, spacing, every))
    if not len(session):
        raise DataError(f"session {session.name}: 0 scans, expected at least one")
    positions, done = session.positions, 0
    last = missed = -1  # the scan used last, and the one since then that could not be

    def apart(k: int, other: int) -> bool:
        away = np.hypot(*(positions[k] - positions[other]))
        return other < 0 or spacing == 0 or bool(away > spacing)

    for k in range(len(session)):
        if not apart(k, last):
            continue
        try:
            value = use(k)
        except BrokenScanError as error:
            instead = not apart(k, missed)
            counted.add(str(error), instead=instead)
            missed = missed if instead else k
            continue
        last, missed, done = k, -1, done + 1
        yield k, value
        if progress is not None:
            progress(done, max(done, counted.total))
    if not done:
        raise DataError(
            f"session {session.name}: none of {len(session)} scans can be used; first: "
            f"{counted.reasons[0]}"
        )
    if left_out is None and len(counted):
        log.warning("%s", counted)

"""How far a sweep is, as its folder tells it: each job's state, counts, and the time left."""

import os
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from deepring.errors import FileError
from deepring.experiment.status import Status, read_status
from deepring.experiment.sweep_notes import INTERRUPTED, KILLED, Note, notes_in
from deepring.experiment.sweep_plan import FILE, PlannedJob, SweepPlan, read_plan
from deepring.experiment.time_left import JobTime, TimeLeft, time_left
from deepring.experiment.workers import Worker

JobState = Literal[
    "finished", "running", "silent", "killed", "failed", "interrupted", "waiting", "not begun"
]

#: Seconds without a sign of life after which a job of another machine is called silent. A running
#: job gives one every 20 seconds.
SILENT = 300.0


@dataclass(frozen=True)
class JobView:
    """A job of a sweep, or a run, as its folder tells it."""

    folder: Path
    state: JobState
    plan: PlannedJob
    status: Status
    """What its ``status.json`` says; of a job that has none, "running" and nothing else."""
    error: str | None = None
    """Why it failed."""
    elapsed: float | None = None
    """Seconds of work until now, of a running one; the seconds that it took, of a finished one."""
    silence: float | None = None
    """Seconds since its last sign of life, of one that has not ended."""

    @property
    def time(self) -> JobTime:
        """What it tells of the time that jobs of its kind take."""
        finished = self.state == "finished"
        return JobTime(
            self.plan.kind,
            self.elapsed if finished else None,
            None if finished else self.elapsed,
            self.status.share,
        )


@dataclass(frozen=True)
class SweepState:
    """A sweep, or several runs in one folder."""

    folder: Path
    plan: SweepPlan | None
    """None for runs that no sweep has planned."""
    runs: bool | None
    """Whether the sweep still runs; None if that cannot be told from this machine."""
    jobs: list[JobView]
    unnamed: int
    """Number of waiting jobs that have no name yet, as in a search."""
    left: TimeLeft

    @property
    def total(self) -> int:
        """Number of jobs."""
        return len(self.jobs) + self.unnamed

    def count(self, *states: JobState) -> int:
        """Number of jobs in these states; unnamed ones are waiting, or not begun."""
        counts = Counter(job.state for job in self.jobs)
        counts["waiting" if self.runs is not False else "not begun"] += self.unnamed
        return sum(counts[state] for state in states)


def state_of(sweep: Path, now: float | None = None) -> SweepState:
    """How far the sweep of a folder is, or the runs in it.

    Raises FileError for a file that cannot be read.
    """
    now = time.time() if now is None else now
    plan = read_plan(sweep)
    notes = {} if plan is None or plan.outcomes is None else _notes(sweep / plan.outcomes)
    runs = _runs(plan)
    planned = {} if plan is None else {job.folder: job for job in plan.jobs}
    begun = [
        path.parent.name
        for path in sorted(sweep.glob("*/status.json"))
        if not path.parent.is_symlink()  # ``latest``, which is one of the others
    ]
    # The folder's last command says what is to be done; an earlier one's runs are shown below it.
    names = dict.fromkeys([*planned, *notes, *begun])
    jobs = []
    for name in names:
        of_plan = name in planned or name in notes
        job = planned.get(name) or PlannedJob(name)
        still = runs if of_plan else False
        jobs.append(_job(sweep / name, job, notes.get(name), still, now))
    unnamed = 0 if plan is None or runs is False else max(0, plan.unnamed - len(jobs))
    return SweepState(sweep, plan, runs, jobs, unnamed, _left(jobs, unnamed, plan))


def states_in(path: Path) -> Iterator[SweepState]:
    """Each sweep in a folder, at any depth, and the runs in folders of no sweep.

    Raises FileError for a path that is no folder or holds no run.
    """
    if not path.is_dir():
        raise FileError(
            f"{path}: no such folder; expected a sweep's or a run's; "
            "see outputs/sweeps, where `deepring train -m` writes"
        )
    if (path / "status.json").is_file():  # a run itself
        job = _job(path, PlannedJob(path.name), None, False, time.time())
        yield SweepState(path.parent, None, None, [job], 0, _left([job], 0, None))
        return
    found = False
    for place, folders, files in os.walk(path):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        here = Path(place)
        if FILE in files or any((here / name / "status.json").is_file() for name in folders):
            found = True
            yield state_of(here)
    if not found:
        raise FileError(
            f"{path}: neither a sweep nor a run in it (a folder with a {FILE} or a status.json, as "
            "`deepring train` leaves); expected the folder of a sweep or a run; name one"
        )


def _notes(folder: Path) -> dict[str, Note]:
    """The outcomes that the jobs of a running sweep have noted, by the names of their folders."""
    return {note.folder.name: note for note in notes_in(folder)}


def _runs(plan: SweepPlan | None) -> bool | None:
    if plan is None or plan.ended is not None:
        return False
    return None if plan.worker is None else plan.worker.lives


def _job(
    folder: Path,
    planned: PlannedJob,
    note: Note | None,
    runs: bool | None,
    now: float,
) -> JobView:
    """A job by its note in this start of the sweep, or else by what its folder holds."""
    status = read_status(folder)
    if note is not None:
        state, error = _ended(note.error) or (_alive(note.worker, _seen(status, note), now), None)
    elif runs is False and planned.error is not None:
        state, error = _ended(planned.error) or ("killed", None)
    elif runs is not False and (status is None or status.state != "finished"):
        state, error = "waiting", None
    elif status is None:
        state, error = "not begun", None
    elif status.state == "running":
        state, error = _alive(status.worker, status.seen, now), None
    else:
        state, error = status.state, status.error
    if note is not None and status is not None and (status.seen or 0.0) < (note.began or 0.0):
        status = None if state != "finished" else status  # of an earlier start
    seen = _seen(status, note)
    return JobView(
        folder,
        state,
        planned,
        status or Status("running"),
        error,
        _elapsed(state, status, note, now),
        None if seen is None or state not in ("running", "silent") else max(0.0, now - seen),
    )


def _ended(error: str | None) -> tuple[JobState, str | None] | None:
    """The state that an outcome tells, and why; None of a job that has not noted its end."""
    if error == KILLED:
        return None
    if error == INTERRUPTED:
        return "interrupted", None
    return ("finished", None) if error is None else ("failed", error)


def _alive(worker: Worker | None, seen: float | None, now: float) -> JobState:
    """Whether a job that has not noted its end still runs."""
    lives = None if worker is None else worker.lives
    if lives is None:
        return "silent" if seen is None or now - seen > SILENT else "running"
    return "running" if lives else "killed"


def _seen(status: Status | None, note: Note | None) -> float | None:
    """The last sign of life."""
    signs = [note.began if note is not None else None, status.seen if status is not None else None]
    return max((sign for sign in signs if sign is not None), default=None)


def _elapsed(state: JobState, status: Status | None, note: Note | None, now: float) -> float | None:
    """Seconds of work, until now if it runs."""
    if state == "finished":
        return None if status is None else status.took or status.seconds
    if state not in ("running", "silent"):
        return None
    if status is not None and status.took is not None and status.seen is not None:
        return status.took + (max(0.0, now - status.seen) if state == "running" else 0.0)
    return None if note is None or note.began is None else max(0.0, now - note.began)


def _left(jobs: list[JobView], unnamed: int, plan: SweepPlan | None) -> TimeLeft:
    """The time until all jobs are done that run, or wait to."""
    of: dict[JobState, list[JobTime]] = {"finished": [], "running": [], "waiting": []}
    for job in jobs:
        of.setdefault(job.state, []).append(job.time)
    waiting = of["waiting"] + [JobTime(PlannedJob("").kind)] * unnamed
    return time_left(of["finished"], of["running"], waiting, plan.at_once if plan else 1)

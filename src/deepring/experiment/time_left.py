"""How long a sweep still takes, by the jobs that are done and the epochs of those that run."""

import heapq
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from statistics import fmean
from typing import NamedTuple

#: The share of a training from which on its speed is told by it.
_TOLD_BY = 0.05

#: What a job that runs longer than others of its kind still takes at least, by its time so far.
_OVERDUE = 0.05


class JobTime(NamedTuple):
    """What is known of a job's time."""

    kind: tuple[Hashable, ...]
    """Jobs of one kind take as long; those whose first value differs have nothing in common."""
    took: float | None = None
    """Seconds of a job that is done."""
    elapsed: float | None = None
    """Seconds of a running job until now."""
    share: float | None = None
    """The share of its training that a running job has done."""


class TimeLeft(NamedTuple):
    """An estimate."""

    seconds: float
    """Until all jobs are done that can be estimated."""
    unknown: int
    """Number of jobs that are left and like no other, so that nothing is known of their time."""


def time_left(
    done: Iterable[JobTime],
    running: Iterable[JobTime],
    waiting: Iterable[JobTime],
    at_once: int | None,
) -> TimeLeft:
    """The time until all jobs are done, of which ``at_once`` run beside each other.

    A job takes as long as those of its kind, or else as the mean of kinds that share its first
    value. A running job alone tells its time by the share of its training, without the evaluation
    after it. None for ``at_once`` stands for as many as run now.
    """
    done, running = list(done), list(running)
    known = _Durations(done, running)
    left, unknown = [], 0
    for job in running:
        seconds = known.left_of(job)
        unknown += seconds is None
        left.append(seconds or 0.0)
    free = sorted(left)
    free += [0.0] * ((at_once or max(1, len(running))) - len(free))
    heapq.heapify(free)
    end = max(left, default=0.0)
    for job in waiting:
        seconds = known.of(job)
        unknown += seconds is None
        end = max(end, until := heapq.heappop(free) + (seconds or 0.0))
        heapq.heappush(free, until)
    return TimeLeft(end, unknown)


class _Durations:
    """Seconds that jobs take, by kind and by the first value of kinds."""

    def __init__(self, done: Sequence[JobTime], running: Sequence[JobTime]) -> None:
        ended, projected = defaultdict(list), defaultdict(list)
        for job in done:
            if job.took is not None:
                ended[job.kind].append(job.took)
        for job in running:
            if (seconds := _projected(job)) is not None:
                projected[job.kind].append(seconds)
        self.ended = {kind: fmean(seconds) for kind, seconds in ended.items()}
        self.kinds = {kind: fmean(seconds) for kind, seconds in projected.items()} | self.ended
        groups = defaultdict(list)
        for kind, mean in self.kinds.items():
            groups[kind[0]].append(mean)
        self.groups = {first: fmean(means) for first, means in groups.items()}

    def of(self, job: JobTime) -> float | None:
        return self.kinds.get(job.kind, self.groups.get(job.kind[0]))

    def left_of(self, job: JobTime) -> float | None:
        elapsed = job.elapsed or 0.0
        told = _projected(job)
        alike = self.ended.get(job.kind, self.of(job) if told is None else None)
        until = [seconds for seconds in (told, alike) if seconds is not None]
        return max(_OVERDUE * elapsed, max(until) - elapsed) if until else None


def _projected(job: JobTime) -> float | None:
    if job.share is None or job.share < _TOLD_BY or job.elapsed is None:
        return None
    return job.elapsed / min(1.0, job.share)

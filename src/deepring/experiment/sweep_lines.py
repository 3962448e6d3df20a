"""The lines of a sweep's log that say how far all of it is."""

import os
from pathlib import Path

from deepring.experiment.sweep_plan import SweepPlan
from deepring.experiment.sweep_state import SweepState, state_of
from deepring.experiment.time_left import TimeLeft
from deepring.progress import duration_text


def begun_line(sweep: Path, plan: SweepPlan) -> str:
    """How many jobs a sweep has, and how to look at it."""
    number = len(plan.jobs) or plan.unnamed
    beside = "" if plan.at_once in (1, None) else f", {plan.at_once} at once"
    here = os.path.relpath(sweep)
    return f"{jobs_text(number)}{beside}; deepring status {here} says how far they are"


def job_begins(folder: Path) -> str:
    """Which of the jobs begins."""
    state = state_of(folder.parent)
    names = [job.folder.name for job in state.jobs]
    number = names.index(folder.name) + 1 if folder.name in names else len(names)
    return f"job {number} of {state.total}"


def job_ended(folder: Path) -> str:
    """How long a job took, how far the sweep is, and how long it still takes."""
    state = state_of(folder.parent)
    took = next(
        (job.elapsed for job in state.jobs if job.folder.name == folder.name and job.elapsed), None
    )
    parts = [] if took is None else [f"done in {duration_text(took)}"]
    return "; ".join([*parts, ", ".join([counts_text(state), *left_text(state)])])


def counts_text(state: SweepState) -> str:
    """How many jobs are in which state: "7 of 48 jobs done, 1 running, 0 failed"."""
    texts = [f"{state.count('finished')} of {jobs_text(state.total)} done"]
    texts += [f"{state.count('running')} running", f"{state.count('failed')} failed"]
    for name in ("killed", "interrupted", "silent"):
        if number := state.count(name):
            texts.append(f"{number} {name}")
    return ", ".join(texts)


def left_text(state: SweepState) -> list[str]:
    """The time left, if jobs are left that run or wait to: "about 1:20 h left"."""
    left = state.left
    jobs = state.count("running", "waiting")
    if jobs == 0:
        return []
    if left.unknown == 0:
        return [f"about {duration_text(left.seconds)} left"]
    if left.unknown == jobs or left.seconds < 1:
        return ["time left not known yet"]
    return [f"more than {duration_text(left.seconds)} left: {_unlike(left)}"]


def _unlike(left: TimeLeft) -> str:
    return f"{jobs_text(left.unknown)} of a kind that has not been timed yet"


def jobs_text(number: int) -> str:
    """A number of jobs."""
    return f"{number} job" if number == 1 else f"{number} jobs"

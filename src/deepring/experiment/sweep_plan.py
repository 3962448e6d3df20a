"""``sweep.json`` in a sweep's folder: which jobs it has, and which process runs them."""

import json
import os
import time
from collections.abc import Hashable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from deepring import checks
from deepring.errors import DataError
from deepring.experiment.json_record import read_record
from deepring.experiment.workers import Worker, worker_of
from deepring.io.files import replacing
from deepring.text import shown

FILE = "sweep.json"


@dataclass(frozen=True)
class PlannedJob:
    """A job of a sweep."""

    folder: str
    """Name of its folder."""
    varied: dict[str, str] = field(default_factory=dict)
    """What the sweep varies: keys to values."""
    part: int = 0
    """Jobs of other parts are of another kind: `deepring compare` has two."""
    error: str | None = None
    """Why it did not finish in the last start that has ended."""

    @property
    def kind(self) -> tuple[Hashable, ...]:
        """What it has in common with jobs that take as long: all but the seed.

        The first value is what it shares with jobs whose time tells something about its own: the
        part and the method.
        """
        values = {key: value for key, value in self.varied.items() if key != "seed"}
        return ((self.part, values.get("method")), *sorted(values.items()))


@dataclass(frozen=True)
class SweepPlan:
    """The jobs of a sweep, and its last start."""

    jobs: tuple[PlannedJob, ...]
    unnamed: int = 0
    """Number of all jobs where a search names each only when it begins, else 0."""
    worker: Worker | None = None
    """The process that started it."""
    began: float | None = None
    """When, in seconds since 1970."""
    ended: float | None = None
    """When that start ended; None while it runs, or if it was killed."""
    at_once: int | None = 1
    """Jobs that run at once; None where a cluster decides."""
    outcomes: str | None = None
    """The folder in the sweep's where the jobs of this start note how they end; gone with it."""


def begin_plan(sweep: Path, plan: SweepPlan) -> SweepPlan:
    """Write the plan of a start of the sweep, and return it.

    Jobs that the same process has planned for this folder are kept, as the other part.
    """
    plan = replace(plan, worker=Worker.here(), began=time.time(), ended=None)
    before = read_plan(sweep)
    if before is not None and before.worker == plan.worker:
        known = {job.folder: job for job in before.jobs}
        new = [job for job in plan.jobs if job.folder not in known]
        part = 1 + max((job.part for job in before.jobs), default=-1)
        further = tuple(replace(job, part=part) for job in new)
        plan = replace(plan, jobs=before.jobs + further, began=before.began)
    _write(sweep, plan)
    return plan


def end_plan(sweep: Path, errors: Mapping[str, str | None]) -> None:
    """Write that this start has ended, and why jobs, by their folders' names, did not finish.

    Does nothing in a folder without a plan.
    """
    plan = read_plan(sweep)
    if plan is None:
        return
    known = {job.folder for job in plan.jobs}
    jobs = [replace(job, error=errors.get(job.folder, job.error)) for job in plan.jobs]
    jobs += [PlannedJob(name, error=errors[name]) for name in errors if name not in known]
    _write(sweep, replace(plan, jobs=tuple(jobs), ended=time.time(), outcomes=None))


def read_plan(sweep: Path) -> SweepPlan | None:
    """The plan in a sweep's folder, or None. Raises FileError if the file cannot be read."""
    expected = "the jobs of a sweep; delete the file, or start the sweep again"
    return read_record(sweep / FILE, _parsed, "the plan of a sweep", expected)


def _write(sweep: Path, plan: SweepPlan) -> None:
    with replacing(sweep / FILE) as temporary:
        temporary.write_text(
            json.dumps(asdict(plan), indent=2) + "\n", encoding="utf-8", errors="backslashreplace"
        )


def _parsed(values: Mapping[str, Any]) -> SweepPlan:
    plan = SweepPlan(
        **{
            **values,
            "jobs": tuple(_job(job) for job in values["jobs"]),
            "worker": worker_of(values.get("worker")),
        }
    )
    checks.count("unnamed", plan.unnamed, 0)
    if plan.at_once is not None:
        checks.count("at_once", plan.at_once)
    for name in ("began", "ended"):
        value = getattr(plan, name)
        if value is not None and not checks.is_number(value):
            raise DataError(f"{name}: {shown(value)}, expected a number")
    if plan.outcomes is not None and Path(plan.outcomes).name != plan.outcomes:
        raise DataError(f"outcomes: {shown(plan.outcomes)}, expected the name of a folder")
    return plan


def _job(values: Mapping[str, Any]) -> PlannedJob:
    job = PlannedJob(**values)
    texts = [job.folder, *job.varied, *job.varied.values()]
    if not all(isinstance(text, str) for text in texts) or not isinstance(job.error, str | None):
        raise DataError(f"jobs: {shown(dict(values))}, expected texts")
    if Path(job.folder).name != job.folder:
        raise DataError(f"jobs: {shown(job.folder)}, expected the name of a folder")
    checks.count("part", job.part, 0)
    return job


def at_once(launcher: Mapping[str, Any]) -> int | None:
    """How many jobs a launcher's config runs at once; None where a cluster decides."""
    kind = str(launcher.get("_target_"))
    if kind.endswith(".BasicLauncher"):
        return 1
    jobs = launcher.get("n_jobs")
    if not isinstance(jobs, int) or jobs == 0:
        return None
    return jobs if jobs > 0 else max(1, (os.cpu_count() or 1) + 1 + jobs)

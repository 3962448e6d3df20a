"""`deepring status`: how far a sweep is, while it runs or afterwards."""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

from deepring.cli.console import console
from deepring.cli.json_output import print_json
from deepring.errors import DeepringError
from deepring.evaluation.results import Result, read_results
from deepring.experiment.sweep_lines import counts_text, jobs_text, left_text
from deepring.experiment.sweep_state import SILENT, JobView, SweepState, states_in
from deepring.progress import duration_text
from deepring.reports.table import NONE, Cell, Table
from deepring.reports.terminal_table import terminal

#: Exit status where a job failed, was killed, or gives no sign of life.
TROUBLE = 1


def status_command(args: argparse.Namespace) -> None:
    """Print the state of each job; exit with 1 if one failed, was killed or is silent."""
    states = [state for path in args.paths for state in states_in(path)]
    if args.form == "json":
        print_json("status", {"sweeps": [_content(state) for state in states]})
    else:
        for number, state in enumerate(states):
            if number:
                console.print("")
            _show(state)
    if any(state.count("failed", "killed", "silent") for state in states):
        sys.exit(TROUBLE)


def _show(state: SweepState) -> None:
    """The state of a sweep as a person reads it."""
    console.print(f"{'sweep' if state.plan else 'runs':<12} {state.folder}")
    console.print(f"{'state':<12} {_whole(state)}")
    console.print(f"{'jobs':<12} {', '.join([counts_text(state), *_rest(state)])}")
    for text in left_text(state):
        console.print(f"{'time':<12} {text}")
    console.print(terminal([_table(state)]))
    for job in state.jobs:
        if job.state == "failed":
            cause = (job.error or "no reason given").strip().splitlines()[0]
            console.print(f"{'failed':<12} {job.folder.name}: {cause}")
    left = state.count("failed", "killed", "interrupted", "not begun")
    if left and state.runs is False:
        console.print("the same command goes on with what is left")


def _whole(state: SweepState) -> str:
    """Whether the sweep runs, since when, and in which process."""
    plan = state.plan
    if plan is None or plan.began is None:
        return "no sweep has planned these runs"
    if plan.ended is not None:
        took = duration_text(plan.ended - plan.began)
        return f"ended {_moment(plan.ended)}, after {took}"
    begun = f"{_moment(plan.began)} ({plan.worker})"
    if state.runs is False:
        return f"killed; it began {begun}"
    if state.runs is None:
        return f"runs on another machine, or was killed there; it began {begun}"
    return f"runs since {begun}"


def _rest(state: SweepState) -> list[str]:
    texts = []
    for name in ("waiting", "not begun"):
        if number := state.count(name):
            texts.append(f"{number} {name}")
    return texts


def _table(state: SweepState) -> Table:
    """A row for each job."""
    heads = [_headline(job) for job in state.jobs]
    places = list(dict.fromkeys(head.case.place for head in heads if head is not None))
    scores = any(job.status.score is not None for job in state.jobs)
    headers = ["job", "state", "time", *(["val R@1"] if scores else []), "R@1"]
    rows = []
    for job, head in zip(state.jobs, heads, strict=True):
        cells = [
            job.folder.name,
            _what(job),
            NONE if job.elapsed is None else duration_text(job.elapsed),
        ]
        if scores:
            cells.append(NONE if job.status.score is None else f"{job.status.score:.3f}")
        cells.append(NONE if head is None else f"{head.recall_1:.3f}")
        rows.append([Cell(text) for text in cells])
    if state.unnamed:
        empty = [NONE] * (len(headers) - 2)
        word = "waiting" if state.runs is not False else "not begun"
        rows.append([Cell(jobs_text(state.unnamed)), Cell(word), *map(Cell, empty)])
    return Table(_title(places, heads), headers, rows, names=2)


def _title(places: Sequence[str], heads: Sequence[Result | None]) -> str:
    radii = sorted({head.radius_m for head in heads if head is not None})
    if not radii:
        return ""
    within = " or ".join(f"{radius:g} m" for radius in radii)
    if len(places) > 1:
        return f"R@1: Recall@1 within {within} on each job's first test, such as {places[0]}"
    return f"R@1: Recall@1 within {within} on {places[0]}"


def _headline(job: JobView) -> Result | None:
    """The job's own method on its first test at the first radius; None where there is none yet."""
    if job.state != "finished":
        return None
    try:
        results = read_results(job.folder / "results.csv")
    except DeepringError:  # as with evaluate=false
        return None
    trained = [result for result in results if result.case.train]
    return next(iter(trained or results), None)


def _what(job: JobView) -> str:
    """The state of a job, and what it does."""
    if job.state == "finished":
        return "done"
    if job.state not in ("running", "silent"):
        return job.state
    texts = [job.status.stage or "begins"]
    if job.status.share is not None:
        texts.append(f"{100 * job.status.share:.0f} %")
    if job.silence is not None and job.silence > SILENT:
        texts.append(f"no sign of life for {duration_text(job.silence)}")
    elif job.state == "silent":
        texts.append("no sign of life")
    return ", ".join(texts)


def _content(state: SweepState) -> dict[str, Any]:
    """The state of a sweep, for the schema ``status``."""
    plan = state.plan
    jobs = state.count("running", "waiting")
    known = jobs > 0 and state.left.unknown < jobs
    return {
        "folder": state.folder,
        "runs": state.runs,
        "began": None if plan is None else plan.began,
        "ended": None if plan is None else plan.ended,
        "total": state.total,
        "counts": {
            name.replace(" ", "_"): state.count(name)  # type: ignore[arg-type]
            for name in _STATES
        },
        "seconds_left": 0.0 if jobs == 0 else state.left.seconds if known else None,
        "not_timed": state.left.unknown,
        "jobs": [_job_content(job) for job in state.jobs],
    }


_STATES = (
    *("finished", "running", "silent", "waiting", "not begun", "failed", "killed", "interrupted"),
)


def _job_content(job: JobView) -> dict[str, Any]:
    head = _headline(job)
    return {
        "folder": job.folder,
        "state": job.state.replace(" ", "_"),
        "varied": job.plan.varied,
        "stage": job.status.stage,
        "share": job.status.share,
        "seconds": job.elapsed,
        "seconds_silent": job.silence,
        "error": job.error,
        "validation": job.status.score,
        "headline": None if head is None else _headline_content(head),
    }


def _headline_content(head: Result) -> dict[str, Any]:
    names = ("method", "train", "test", "region")
    values = {name: getattr(head.case, name) for name in names}
    return {**values, "radius_m": head.radius_m, "recall_1": head.recall_1}


def _moment(seconds: float) -> str:
    """A moment in local time, with its date unless it is today's."""
    moment = time.localtime(seconds)
    today = time.strftime("%Y-%m-%d") == time.strftime("%Y-%m-%d", moment)
    return time.strftime("%H:%M" if today else "%Y-%m-%d %H:%M", moment)

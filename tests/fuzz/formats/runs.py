"""Folders of runs and of simulations: results, status, config, versions, retrievals, manifest."""

import json
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches, matches_in, write_matches
from deepring.evaluation.results import Result, write_results
from deepring.experiment.report import report
from deepring.experiment.runs import find_runs
from deepring.experiment.status import Status, write_status
from deepring.paper.ablation import ablation_tables
from deepring.paper.ablation_tables import shown_table
from deepring.paper.comparison import compare, is_comparison
from deepring.paper.comparison_tables import shown_tables
from deepring.simulation.manifest import claim
from deepring.simulation.presets import tiny
from deepring.simulation.simulate import simulate
from fuzz.decoders.run_files import CONFIG, MATCHES, RUN, stated_run
from fuzz.files import Files, Format, Mutation, read_back
from fuzz.mutations.raw import raw
from fuzz.mutations.text import text
from fuzz.mutations.values import as_json, changed
from fuzz.mutations.yaml_keys import yaml_keys
from helpers.results import result_of


def formats() -> Iterator[Format]:
    """All files of runs, each changed by itself."""
    mutations: dict[str, tuple[Mutation, ...]] = {
        "results.csv": (text(f"{RUN}/results.csv"),),
        "status.json": (_json(f"{RUN}/status.json"), _json(f"{RUN}/status.json")),
        "versions.json": (_json(f"{RUN}/versions.json"), _json(f"{RUN}/versions.json")),
        "config.yaml": (yaml_keys(f"{RUN}/config.yaml"), text(f"{RUN}/config.yaml")),
        "retrievals": (text(MATCHES),),
    }
    for name, changes in mutations.items():
        file = MATCHES if name == "retrievals" else f"{RUN}/{name}"
        yield Format(
            f"run {name}", lambda _: _run(), (*changes, *changes, raw(file)), _tables, stated_run
        )
    page = ("results.csv", "config.yaml")
    yield Format(
        "report",
        lambda _: _run(),
        (
            text(*(f"{RUN}/{name}" for name in page)),
            yaml_keys(f"{RUN}/config.yaml"),
            raw(f"{RUN}/results.csv", f"{RUN}/config.yaml"),
        ),
        _page,
        weight=2,
    )
    manifest = "sim/simulation.json"
    yield Format(
        "simulation.json",
        _simulated,
        (_json(manifest), _json(manifest), raw(manifest)),
        _claimed,
        weight=2,
    )


def _json(name: str) -> Mutation:
    def mutate(rng: Random, files: Files) -> str:
        value, done = changed(rng, json.loads(files[name]))
        files[name] = as_json(value).encode()
        return f"{name}: {done}"

    return mutate


@cache
def _run() -> Files:
    """A finished run with all its files, of a method that learns nothing."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / RUN
        case = Case("RING", "", "sim", "test")
        run.mkdir(parents=True)
        write_results(run / "results.csv", [result_of(case, radius) for radius in (10.0, 5.0)])
        write_status(run, Status("finished", score=0.5, seconds=90.5))
        (run / "versions.json").write_text(json.dumps({"git_commit": "c0ffee", "seed": 3}))
        (run / "config.yaml").write_text(CONFIG)
        n = np.arange(5)
        matches = TopMatches(
            case,
            n,
            n[:, None] + 1,
            *(np.float32(n[:, None] / 3 + k) for k in range(3)),
            np.float32(n),
        )
        write_matches(run, matches)
        return read_back(Path(folder))


def _tables(folder: Path) -> Any:
    """What a run holds; its tables are made, and its matches read."""
    runs = find_runs([folder / "sweep"]).runs
    options: dict[str, Any] = {"mix": False, "notes": []}
    try:
        if is_comparison(runs):
            shown_tables(compare(runs, 10.0, "answerable", **options))
        else:
            [shown_table(table) for table in ablation_tables(runs, 10.0, "answerable", **options)]
    finally:
        pass
    rows = [[*r.case.columns.values(), *_numbers(r)] for run in runs for r in run.results]
    matches = [m for run in runs for m in matches_in(run.folder)]
    return {
        "config": [run.config for run in runs],
        "seconds": [run.seconds for run in runs],
        "commits": [run.commits for run in runs],
        "results": rows,
        "matches": [
            [m.query.tolist(), m.place.tolist(), m.score.tolist(), m.nearest.tolist()]
            for m in matches
        ],
    }


def _numbers(result: Result) -> list[float]:
    return [value for name, value in vars(result).items() if name != "case"]


def _page(folder: Path) -> Any:
    """The page of a run, in which nothing of its files is a tag."""
    page = report(folder / RUN)
    return page.count("<script") + page.count("<img") + page.count("\x1b")


@cache
def _simulation() -> Files:
    with tempfile.TemporaryDirectory() as folder:
        root = simulate(tiny("nclt"), Path(folder) / "sim")
        files = read_back(root.parent)
        # Only names and numbers of the scans are looked at.
        return {name: c if name.endswith("json") else c[:8] for name, c in files.items()}


def _simulated(_: Path) -> Files:
    return _simulation()


def _claimed(folder: Path) -> Any:
    return claim(folder / "sim", tiny("nclt"))

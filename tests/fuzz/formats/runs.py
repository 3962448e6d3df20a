"""Folders of runs and of simulations: results, status, config, versions, retrievals, manifest."""

import csv
import io
import json
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml

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
from deepring.simulation.settings import tiny
from deepring.simulation.simulate import simulate
from fuzz.files import Files, Format, Mutation, UndecidedError, UndecodableError, read_back
from fuzz.mutations.raw import raw
from fuzz.mutations.text import text
from fuzz.mutations.values import as_json, changed
from fuzz.mutations.yaml_keys import yaml_keys

_RUN = "sweep/run"
_MATCHES = f"{_RUN}/retrievals/RING__sim__test.csv"


def formats() -> Iterator[Format]:
    """All files of runs, each changed by itself."""
    mutations: dict[str, tuple[Mutation, ...]] = {
        "results.csv": (text(f"{_RUN}/results.csv"),),
        "status.json": (_json(f"{_RUN}/status.json"), _json(f"{_RUN}/status.json")),
        "versions.json": (_json(f"{_RUN}/versions.json"), _json(f"{_RUN}/versions.json")),
        "config.yaml": (yaml_keys(f"{_RUN}/config.yaml"), text(f"{_RUN}/config.yaml")),
        "retrievals": (text(_MATCHES),),
    }
    for name, changes in mutations.items():
        file = _MATCHES if name == "retrievals" else f"{_RUN}/{name}"
        yield Format(
            f"run {name}", lambda _: _run(), (*changes, *changes, raw(file)), _tables, _stated
        )
    page = ("results.csv", "config.yaml")
    yield Format(
        "report",
        lambda _: _run(),
        (
            text(*(f"{_RUN}/{name}" for name in page)),
            yaml_keys(f"{_RUN}/config.yaml"),
            raw(f"{_RUN}/results.csv", f"{_RUN}/config.yaml"),
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
        run = Path(folder) / _RUN
        case = Case("RING", "", "sim", "test")
        rates = (10.0, 50, 100, 50, 0.5, 0.9, 0.8, 0.7, 0.1, 0.1)
        run.mkdir(parents=True)
        write_results(run / "results.csv", [Result(case, *rates), Result(case, 5.0, *rates[1:])])
        write_status(run, Status("finished", score=0.5, seconds=90.5))
        (run / "versions.json").write_text(json.dumps({"git_commit": "c0ffee", "seed": 3}))
        (run / "config.yaml").write_text(_CONFIG)
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


_CONFIG = """\
experiment_name: demo
seed: 3
data:
  name: sim
  format: nclt
  root: /nowhere/sim
  spacing: {database: 20.0, query: 5.0, train: 1.0}
  regions: {test: null, margin: 50.0}
evaluation: {regions: [test], radii: [10.0, 5.0], over: answerable}
paths: {outputs: outputs, run: outputs/run}
method: null
methods:
  ring: {_target_: deepring.methods.ring.Ring, angles: 60, bins: 31}
optimizer: {lr: 0.001}
"""


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


def _stated(files: Mapping[str, bytes]) -> Any:
    """The same, read by the standard library's own readers."""
    status, versions = (_object(files[f"{_RUN}/{n}.json"]) for n in ("status", "versions"))
    if status.get("state") != "finished" or "git_commit" not in versions:
        raise UndecodableError("no finished run")
    commit = versions["git_commit"]
    config = _yaml(files[f"{_RUN}/config.yaml"])
    rows = []
    for row in _csv(files[f"{_RUN}/results.csv"], 0)[1:]:
        numbers = [int(v) if 5 <= k < 8 else float(v) for k, v in enumerate(row) if k >= 4]
        rows.append([*row[:4], *numbers])
    lines = _csv(files[_MATCHES], 1)[1:]
    columns = list(zip(*lines, strict=True)) if lines else [()] * 6
    return {
        "config": [config],
        "seconds": [status.get("seconds")],
        "commits": [[str(commit)] if commit is not None else []],
        "results": rows,
        "matches": [
            [
                [int(v) for v in columns[0]],
                [[int(v)] for v in columns[1]],
                [[float(np.float32(float(v)))] for v in columns[2]],
                [float(np.float32(float(v))) for v in columns[5]],
            ]
        ],
    }


def _object(content: bytes) -> dict[str, Any]:
    try:
        value = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        raise UndecodableError("no JSON") from None
    if not isinstance(value, dict):
        raise UndecodableError("no JSON object")
    return value


def _yaml(content: bytes) -> Any:
    if b"${" in content or b"???" in content:
        raise UndecidedError  # OmegaConf resolves these
    try:
        value = yaml.safe_load(content.decode("utf-8-sig"))
    except (yaml.YAMLError, ValueError, RecursionError, TypeError):
        raise UndecodableError("no YAML") from None
    if value != _yaml_of_good() and value is not None:
        raise UndecidedError  # OmegaConf has numbers of its own
    return value


@cache
def _yaml_of_good() -> Any:
    return yaml.safe_load(_CONFIG)


def _csv(content: bytes, skip: int) -> list[list[str]]:
    try:
        lines = content.decode("utf-8-sig")
        for _ in range(skip):
            lines = lines.partition("\n")[2]
        return [row for row in csv.reader(io.StringIO(lines, newline=""), strict=True) if row]
    except (csv.Error, ValueError):
        raise UndecodableError("no CSV") from None


def _page(folder: Path) -> Any:
    """The page of a run, in which nothing of its files is a tag."""
    page = report(folder / _RUN)
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

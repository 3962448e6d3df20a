"""The files of a run, read by the standard library's own readers and PyYAML."""

import csv
import io
import json
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import yaml

from fuzz.decoders.points import rounded
from fuzz.files import UndecidedError, UndecodableError

RUN = "sweep/run"
MATCHES = f"{RUN}/retrievals/RING__sim__test.csv"

#: Columns of results.csv that follow from the others: the bounds of three recalls.
BOUNDS = (10, 11, 13, 14, 16, 17)

#: The config of the good run.
CONFIG = """\
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


def stated_run(files: Mapping[str, bytes]) -> Any:
    """The values of a finished run's files."""
    status, versions = (_object(files[f"{RUN}/{n}.json"]) for n in ("status", "versions"))
    if status.get("state") != "finished" or "git_commit" not in versions:
        raise UndecodableError("no finished run")
    commit = versions["git_commit"]
    config = _yaml(files[f"{RUN}/config.yaml"])
    rows = []
    for row in _csv(files[f"{RUN}/results.csv"], 0)[1:]:
        numbers = [_number(v, k in (6, 7, 8)) for k, v in enumerate(row) if k >= 4]
        rows.append([*row[:4], *(v for k, v in enumerate(numbers, 4) if k not in BOUNDS)])
    lines = _csv(files[MATCHES], 1)[1:]
    columns = _columns(lines)
    return {
        "config": [config],
        "seconds": [status.get("seconds")],
        "commits": [[str(commit)] if commit is not None else []],
        "results": rows,
        "matches": [
            [
                [_number(v, True) for v in columns[0]],
                [[_number(v, True)] for v in columns[1]],
                [[rounded(_number(v))] for v in columns[2]],
                [rounded(_number(v)) for v in columns[5]],
            ]
        ],
    }


def _columns(rows: list[list[str]]) -> list[list[str]]:
    if any(len(row) != 6 for row in rows):
        raise UndecodableError("a row of another length")
    return [[row[k] for row in rows] for k in range(6)]


def _number(text: str, whole: bool = False) -> float:
    if not re.fullmatch(r"[-+]?[0-9]{1,25}" if whole else r"[-+.0-9eEinfa]+", text):
        raise UndecodableError("a value that is no number")
    try:
        return int(text) if whole else float(text)
    except ValueError:
        raise UndecodableError("a value that is no number") from None


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
    except (yaml.YAMLError, ValueError, RecursionError, TypeError, AttributeError):
        raise UndecodableError("no YAML") from None
    if value != _yaml_of_good() and value is not None:
        raise UndecidedError  # OmegaConf has numbers of its own
    return value


@cache
def _yaml_of_good() -> Any:
    return yaml.safe_load(CONFIG)


def _csv(content: bytes, skip: int) -> list[list[str]]:
    try:
        lines = content.decode("utf-8-sig")
        for _ in range(skip):
            lines = re.split(r"\r\n|\n|\r", lines, maxsplit=1)[-1]
        return [row for row in csv.reader(io.StringIO(lines, newline=""), strict=True) if row]
    except (csv.Error, ValueError):
        raise UndecodableError("no CSV") from None

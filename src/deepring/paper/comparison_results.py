"""From the runs of a comparison to its rows: a method, trained here, tested there, on all seeds."""

import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.evaluation.metrics import Over
from deepring.evaluation.reranked_labels import method_label
from deepring.paper.flat import flatten
from deepring.paper.seed_groups import (
    HEADLINE,
    Run,
    RunResult,
    SeedGroup,
    Stated,
    comparable,
    counts,
    results_at,
    seed_groups,
)

#: What a trained method is made with, beside the data.
_MADE = re.compile(
    r"(method|loss|sampling|augmentation|optimizer|scheduler|trainer|callbacks|stages)\..*"
)

#: What of a dataset matters where it is trained on, and not where it is tested on.
_OF_TRAINING = ("spacing.train", *(f"regions.{k}" for k in ("validation_share", "margin")))


def collect_cases(
    runs: Sequence[Run], radius: float, over: Over = "answerable", *, mix: bool = False
) -> tuple[list[SeedGroup], list[str]]:
    """Each method, training, dataset and region as one row, and what is to be said of them.

    Args:
        runs: finished runs.
        radius: metres; the results at this radius are taken.
        over: recall as the share of the answerable queries, or of all.
        mix: let runs on different data or under different protocols stand beside each other.

    Raises:
        DeepringError: no run, no result at this radius, an unknown ``over``, two results of one
            case and seed that differ, or, without ``mix``, runs whose data, protocols or settings
            differ; the key, its values and both run folders are named.
    """
    results = [
        RunResult(run, result, _made(run, result.case))
        for run in runs
        for result in results_at(run, radius)
    ]
    stated: list[Stated] = [("protocol", run, _protocol(run)) for run in runs]
    stated += [each for run in runs for each in _stated_datasets(run)]
    for each in results:
        place, seed = each.result.case.place, each.run.seed
        counted = counts(each.result, f" on {place} (seed {seed})")
        stated.append((("counts", place, seed), each.run, counted))
    for each in results:
        if each.setting:
            case = each.result.case
            stated.append((("made", case.method, case.train), each.run, each.setting))
    notes = comparable(runs, stated, mix=mix)
    return seed_groups(results, over, lambda each: each.result.case), notes


def remarks_of(runs: Iterable[Run]) -> dict[str, list[str]]:
    """Method to what its configs say in ``method.note``."""
    remarks: dict[str, list[str]] = {}
    for run in runs:
        note = _method(run).get("note")
        for label in _own_labels(run) if note else ():
            if str(note) not in remarks.setdefault(label, []):
                remarks[label].append(str(note))
    return remarks


def training_minutes(runs: Iterable[Run]) -> dict[str, float]:
    """Method to its mean training time, where that was noted."""
    noted: dict[str, list[float]] = {}
    for run in runs:
        if run.seconds is not None:
            for label in _own_labels(run):
                noted.setdefault(label, []).append(run.seconds / 60)
    return {label: statistics.fmean(values) for label, values in noted.items()}


def _made(run: Run, case: Case) -> dict[str, Any]:
    """The settings that made a method; for one that learns nothing, its own config node."""
    label = method_label(case.method)
    aligned: dict[str, Any] = {}
    if label != case.method:
        aligned = {"evaluation.candidates": run.setting.get("evaluation.candidates")}
    if case.train:
        made = {key: value for key, value in run.setting.items() if _MADE.fullmatch(key)}
        return made | aligned
    nodes = [_method(run), *(run.config.get("methods") or {}).values()]
    own = [node for node in nodes if node and node.get("label") == label]
    plain = {key: value for key, value in (own[0] if own else {}).items() if key != "note"}
    return flatten(plain, label) | aligned


def _protocol(run: Run) -> dict[str, Any]:
    """Settings that belong to no dataset: how checkpoints are chosen, and the preprocessing."""
    evaluation = run.config.get("evaluation") or {}
    radii = evaluation.get("radii") or [None]
    first = {HEADLINE: radii[0]}
    first |= {f"evaluation.{name}": evaluation.get(name) for name in ("over", "wrong_beyond")}
    return flatten(first) | flatten(run.config.get("preprocessing"), "preprocessing")


def _stated_datasets(run: Run) -> Iterator[Stated]:
    """The values that a run states for each dataset; its folder may vary with the seed.

    Training datasets are compared with training datasets, and test datasets with test datasets.
    """
    for side, node in _datasets(run):
        name = node["name"]
        values = flatten({key: value for key, value in node.items() if key != "root"})
        relevant = {k: v for k, v in values.items() if side == "train" or k not in _OF_TRAINING}
        yield (side, name), run, {f"data {name} {key}": value for key, value in relevant.items()}
        root = {f"data {name} root (seed {run.seed})": node.get("root")}
        yield ("root", name, run.seed), run, root


def _datasets(run: Run) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """'train' or 'test' and the dataset; ``data`` stands in where a side names none."""
    trains = any(result.case.train for result in run.results)
    for side in ("train", "test"):
        nodes = run.config.get(f"{side}_data") or {}
        if side == "train" and not trains:
            continue
        for node in nodes.values() or [run.config.get("data")]:
            if not node:
                continue
            if not isinstance(node.get("name"), str):
                raise DataError(
                    f"{run.folder}: a dataset without a name in its config; expected data.name; "
                    "leave this folder out"
                )
            yield side, node


def _own_labels(run: Run) -> set[str]:
    """Labels of the run's method in its results: of what it trained, else of its config."""
    trained = {result.case.method for result in run.results if result.case.train}
    return trained or {str(_method(run).get("label"))}


def _method(run: Run) -> Mapping[str, Any]:
    """The config's node of the run's own method."""
    return run.config.get("method") or {}

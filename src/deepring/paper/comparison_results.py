"""From the runs of a comparison to what is compared: a method, trained here, tested there.

Runs stand beside each other only where they were tested on the same data in the same way, and are
one mean only where they differ in nothing but the seed.
"""

import math
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deepring.errors import DeepringError
from deepring.evaluation.case import Case
from deepring.evaluation.metrics import Over
from deepring.evaluation.results import Result
from deepring.paper.flat import flatten
from deepring.paper.seed_groups import (
    COUNTED,
    HEADLINE,
    Run,
    about_commits,
    clash_of,
    rates,
    seed_of,
    setting_of,
)
from deepring.reports.results_table import recall

#: What a trained method is made with, beside the data.
_MADE = re.compile(r"(method|loss|sampling|optimizer|scheduler|trainer|callbacks)\..*")


@dataclass(frozen=True, eq=False)
class Tested:
    """What a case gives, a result a seed."""

    case: Case
    results: Mapping[int, Result]
    """In rising order of seeds, all at one radius."""
    over: Over

    def values(self, metric: str) -> dict[int, float]:
        """Seed to 'recall_1', 'recall_5' (both over the queries asked for), 'f1_max' or 'auc'."""
        if metric.startswith("recall"):
            k = int(metric.removeprefix("recall_"))
            return {seed: recall(result, k, self.over) for seed, result in self.results.items()}
        return {seed: getattr(result, metric) for seed, result in self.results.items()}


@dataclass(frozen=True, eq=False)
class Collected:
    """All that was tested, and what is to be said of it."""

    tested: list[Tested]
    remarks: dict[str, list[str]]
    """Method to what its configs say in ``method.note``."""
    minutes: dict[str, float]
    """Method to its mean training time, where that was noted."""
    notes: list[str]


@dataclass(frozen=True, eq=False)
class _Part:
    """A result as it enters a case."""

    folder: str
    seed: int
    case: Case
    result: Result
    made: Mapping[str, Any]

    @property
    def counted(self) -> dict[str, Any]:
        where = f"on {self.case.place}"
        return {f"results {name} {where}": getattr(self.result, name) for name in COUNTED}


@dataclass(frozen=True, eq=False)
class _Stated:
    """Values that a run states, under the keys by which they are named."""

    folder: str
    seed: int
    values: Mapping[str, Any]


def collect(
    runs: Sequence[Run], radius: float, over: Over = "answerable", *, mix: bool = False
) -> Collected:
    """What was tested, each method, training, dataset and region with all its seeds.

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
    parts = [part for run in runs for part in _parts(run, radius)]
    if not parts:
        raise DeepringError("runs: no result in any; expected at least one that has finished")
    recall(parts[0].result, 1, over)  # refuses what is no ``over``
    clash = _clash(runs, parts)
    if clash and not mix:
        raise DeepringError(
            f"{clash}; expected runs on the same data under the same protocol, those of one "
            "method with the same settings, since they are compared with each other; give runs "
            "that agree, or `mix` to see them side by side"
        )
    notes = about_commits(runs)
    if clash:
        notes.append(f"mixed, so that rows may not be comparable: {clash}")
    tested = [
        Tested(case, {seed: group[seed].result for seed in sorted(group)}, over)
        for case, group in _cases(parts).items()
    ]
    return Collected(tested, _remarks(runs), _minutes(runs), notes)


def _parts(run: Run, radius: float) -> Iterator[_Part]:
    seed = seed_of(run)
    cases: dict[Case, list[Result]] = {}
    for result in run.results:
        cases.setdefault(result.case, []).append(result)
    for case, results in cases.items():
        found = [result for result in results if math.isclose(result.radius_m, radius)]
        if not found:
            known = ", ".join(f"{r:g}" for r in sorted({result.radius_m for result in results}))
            raise DeepringError(
                f"radius {radius:g} m: no result of {case} in {run.folder}; radii evaluated "
                f"there: {known}; choose one of them with `radius`, or evaluate at this radius "
                "(evaluation.radii)"
            )
        for result in found:
            yield _Part(run.folder, seed, case, result, _made(run, case))


def _made(run: Run, case: Case) -> dict[str, Any]:
    """What a method was made with; of one that learns nothing, what its own config says."""
    if case.train:
        setting = setting_of(run)
        return {key: value for key, value in setting.items() if _MADE.fullmatch(key)}
    nodes = [_method(run), *(run.config.get("methods") or {}).values()]
    own = [node for node in nodes if node and node.get("label") == case.method]
    plain = {key: value for key, value in (own[0] if own else {}).items() if key != "note"}
    return flatten(plain, case.method)


def _method(run: Run) -> Mapping[str, Any]:
    """What the config says of the run's own method."""
    return run.config.get("method") or {}


def _cases(parts: Iterable[_Part]) -> dict[Case, dict[int, _Part]]:
    cases: dict[Case, dict[int, _Part]] = {}
    for part in parts:
        other = cases.setdefault(part.case, {}).setdefault(part.seed, part)
        # Several runs may evaluate a method that learns nothing: the same to the last digit.
        if rates(other.result) != rates(part.result):
            raise DeepringError(
                f"{part.case}, seed {part.seed}: twice, with other figures: Recall@1 "
                f"{other.result.recall_1} in {other.folder}, {part.result.recall_1} in "
                f"{part.folder}; expected one run a seed; leave one of the two out of the "
                "paths, or delete it"
            )
    return cases


def _clash(runs: Sequence[Run], parts: Sequence[_Part]) -> str | None:
    """The first disagreement of protocol, data, counts or settings, in words."""
    made = [part for part in parts if part.made]
    return (
        _first_clash([[_Stated(run.folder, seed_of(run), _protocol(run)) for run in runs]])
        or _first_clash(_stated_datasets(runs))
        or clash_of(parts, lambda part: part.counted, lambda part: (part.case.place, part.seed))
        or _first_clash(
            [_Stated(part.folder, part.seed, part.made) for part in group]
            for group in _grouped(made).values()
        )
    )


def _first_clash(groups: Iterable[Iterable[_Stated]]) -> str | None:
    clashes = (clash_of(group, lambda stated: stated.values) for group in groups)
    return next(filter(None, clashes), None)


def _grouped(parts: Iterable[_Part]) -> dict[tuple[str, str], list[_Part]]:
    groups: dict[tuple[str, str], list[_Part]] = {}
    for part in parts:
        groups.setdefault((part.case.method, part.case.train), []).append(part)
    return groups


def _protocol(run: Run) -> dict[str, Any]:
    """What does not go with a dataset: by what checkpoints were chosen, and the preprocessing."""
    evaluation = run.config.get("evaluation") or {}
    radii = evaluation.get("radii") or [None]
    first = {HEADLINE: radii[0], "evaluation.over": evaluation.get("over")}
    return flatten(first) | flatten(run.config.get("preprocessing"), "preprocessing")


def _stated_datasets(runs: Iterable[Run]) -> list[list[_Stated]]:
    """What runs state of each dataset, by its name; where it lies may go with the seed.

    What they train on is held against each other, and so is what they test on.
    """
    groups: dict[object, list[_Stated]] = {}
    for run in runs:
        seed = seed_of(run)
        for side, node in _datasets(run):
            name = node["name"]
            values = flatten({key: value for key, value in node.items() if key != "root"})
            kept = {k: v for k, v in values.items() if side == "train" or k not in _OF_TRAINING}
            named = {f"data {name} {key}": value for key, value in kept.items()}
            root = {f"data {name} root (seed {seed})": node.get("root")}
            groups.setdefault((side, name), []).append(_Stated(run.folder, seed, named))
            groups.setdefault((name, seed), []).append(_Stated(run.folder, seed, root))
    return list(groups.values())


#: What of a dataset matters where it is trained on, and not where it is tested on.
_OF_TRAINING = ("spacing.train", *(f"regions.{k}" for k in ("validation_share", "margin")))


def _datasets(run: Run) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """'train' or 'test' and the dataset; ``data`` stands in where a side names none."""
    trains = any(result.case.train for result in run.results)
    for side in ("train", "test"):
        nodes = run.config.get(f"{side}_data") or {}
        if side == "train" and not trains:
            continue
        for node in nodes.values() or [run.config.get("data")]:
            if node:
                yield side, node


def _own_labels(run: Run) -> set[str]:
    """What the run's method is called in its results: what it trained, else what it states."""
    trained = {result.case.method for result in run.results if result.case.train}
    return trained or {str(_method(run).get("label"))}


def _remarks(runs: Iterable[Run]) -> dict[str, list[str]]:
    remarks: dict[str, list[str]] = {}
    for run in runs:
        note = _method(run).get("note")
        for label in _own_labels(run) if note else ():
            if str(note) not in remarks.setdefault(label, []):
                remarks[label].append(str(note))
    return remarks


def _minutes(runs: Iterable[Run]) -> dict[str, float]:
    noted: dict[str, list[float]] = {}
    for run in runs:
        if run.seconds is not None:
            for label in _own_labels(run):
                noted.setdefault(label, []).append(run.seconds / 60)
    return {label: statistics.fmean(values) for label, values in noted.items()}

"""From the runs of an ablation to rows: runs that differ in nothing but the seed are one row."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from deepring.evaluation.metrics import Over
from deepring.paper.flat import frozen
from deepring.paper.seed_groups import (
    HEADLINE,
    Run,
    RunResult,
    SeedGroup,
    comparable,
    counts,
    first_clash,
    results_at,
    seed_groups,
)

#: The name of the trained network in the results of a training run.
TRAINED = "DeepRING"

#: What must agree between runs that are compared. Where the data lie may go with the seed.
_ROOT = re.compile(r"(data|(train|test)_data\.[^.]+)\.root")
PROTOCOL = re.compile(r"(data|train_data|test_data|preprocessing|evaluation)\..*")


def collect_rows(
    runs: Sequence[Run], radius: float = 10.0, over: Over = "answerable", *, mix: bool = False
) -> tuple[list[SeedGroup], list[str]]:
    """Runs that differ in nothing but the seed as one row, and what is to be said of them.

    Args:
        runs: finished runs, each with a result of the trained network.
        radius: metres; the results at this radius are taken.
        over: recall as the share of the answerable queries, or of all.
        mix: let runs on different data or under different protocols stand beside each other.

    Raises:
        DeepringError: no run, no result at this radius, an unknown ``over``, two runs of one row
            and seed with other results, or, without ``mix``, runs whose data or protocols differ;
            the key, its values and both run folders are named.
    """
    results = [
        RunResult(run, result, _setting(run))
        for run in runs
        for result in results_at(run, radius, TRAINED)
    ]
    protocols, roots, counted = [], [], []
    for each in results:
        run, seed = each.run, f" (seed {each.run.seed})"
        protocol = _protocol(each)
        protocols.append(("protocol", run, protocol))
        places = {f"{k}{seed}": v for k, v in each.setting.items() if _ROOT.fullmatch(k)}
        # Mixed, places and counts are held against each other under one protocol alone.
        group = (seed, frozen(protocol) if mix else "")
        roots.append((("roots", *group), run, places))
        case = each.result.case
        tested = {f"results test{seed}": case.test, f"results region{seed}": case.region}
        counted.append((("counts", *group), run, tested | counts(each.result, seed)))
    notes = comparable(runs, [*protocols, *roots, *counted], mix=mix)
    if first_clash(roots) is None:
        results = [replace(each, setting=_without_roots(each)) for each in results]
    return seed_groups(results, over, lambda each: frozen(each.setting)), notes


def learnt_by(run: Run) -> dict[str, Any]:
    """The settings of a run without its data, its protocol and its seed."""
    setting = _setting(run)
    return {key: value for key, value in setting.items() if not PROTOCOL.fullmatch(key)}


def by_place(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Each place that runs were tested in, and the runs with their results there alone."""
    places = dict.fromkeys(result.case.place for run in runs for result in run.results)
    return {
        place: [
            replace(run, results=results)
            for run in runs
            if (results := [result for result in run.results if result.case.place == place])
        ]
        for place in places
    }


def _setting(run: Run) -> dict[str, Any]:
    setting = run.setting
    # The other radii are counted besides, and change nothing.
    radii = setting.pop("evaluation.radii", None)
    return setting | {HEADLINE: radii[0]} if radii else setting


def _without_roots(result: RunResult) -> dict[str, Any]:
    return {key: value for key, value in result.setting.items() if not _ROOT.fullmatch(key)}


def _protocol(result: RunResult) -> dict[str, Any]:
    setting = _without_roots(result)
    return {key: value for key, value in setting.items() if PROTOCOL.fullmatch(key)}

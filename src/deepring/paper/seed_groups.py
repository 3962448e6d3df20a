"""From finished runs to the rows of tables: runs that differ in nothing but the seed are one row.

Rows stand beside each other only where they were tested on the same data in the same way.
"""

import math
import re
import statistics
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from deepring.checks import one_of
from deepring.errors import DataError
from deepring.evaluation.case import Case
from deepring.evaluation.intervals import wilson
from deepring.evaluation.metrics import Over
from deepring.evaluation.results import RECALLS, Result
from deepring.paper.flat import INDIFFERENT, flatten, frozen
from deepring.reports.results_table import counted, interval_text, recall, within_text
from deepring.text import shown

#: The first radius of a config, by which the checkpoint was chosen.
HEADLINE = "evaluation.radii[0]"

#: The note on what stands in parentheses behind a recall.
ABOUT_INTERVALS = "in parentheses the 95 % interval (Wilson) for the queries of one seed"

#: Keys that cannot change what is learnt, among them what a run is compared with.
_IRRELEVANT = re.compile(
    INDIFFERENT
    + r"|(seed|checkpoint|methods|evaluate|overlap|evaluation\.(figures|descriptors))(\..*)?"
    r"|method\.(label|note)"
    r"|(stages\.[^.]+\.)?trainer\.(_target_|accelerator|log_every_n_steps|num_sanity_val_steps|profiler"
    r"|enable_.*|deterministic|default_root_dir|logger|callbacks)"
)

#: The method's preprocessing, which follows the config's unless it is set apart.
_RASTER = "method.raster."


@dataclass(frozen=True, eq=False)
class Run:
    """A finished training run."""

    folder: str
    config: Mapping[str, Any]
    """Resolved, of plain dicts, lists and values."""
    results: Sequence[Result]
    commits: Sequence[str] = ()
    """Commits of the code; several if the run was resumed with other code."""
    seconds: float | None = None
    """That the training took; None where nothing was trained, or nobody noted it."""

    @property
    def seed(self) -> int:
        """The seed in its config. Raises DataError unless it is a whole number."""
        seed = self.config.get("seed")
        if not isinstance(seed, int):
            raise DataError(
                f"{self.folder}: seed {shown(seed)} in its config; expected a whole number; "
                "leave this folder out"
            )
        return seed

    @property
    def setting(self) -> dict[str, Any]:
        """Dotted keys to values of its config, without those that cannot change what is learnt."""
        flat = flatten(self.config)
        return {
            key: value
            for key, value in flat.items()
            if not _IRRELEVANT.fullmatch(key) and not _repeated(key, flat)
        }


@dataclass(frozen=True, eq=False)
class RunResult:
    """A result as it enters a row."""

    run: Run
    result: Result
    setting: Mapping[str, Any]
    """The settings that made it."""


@dataclass(frozen=True, eq=False)
class SeedGroup:
    """A row: what one setting, or one case, gives, a result for each seed."""

    case: Case
    setting: Mapping[str, Any]
    """Dotted config keys to values; absent where null."""
    results: Mapping[int, Result]
    """In rising order of seeds, all at one radius."""
    over: Over

    def values(self, metric: str = "recall_1") -> dict[int, float]:
        """Seed to a recall (over the queries asked for), 'f1_max', 'auc' or 'ap'."""
        if metric in RECALLS:
            return {seed: recall(r, metric, self.over) for seed, r in self.results.items()}
        return {seed: getattr(result, metric) for seed, result in self.results.items()}

    def with_interval(self, seed: int) -> tuple[float | None, float | None, float | None]:
        """Recall@1 of a seed and its 95 % interval; None where the row has no such seed."""
        if seed not in self.results:
            return None, None, None
        share = self.values()[seed]
        return share, *wilson(share, counted(self.results[seed], self.over))

    def interval_text(self, seeds: Collection[int] | None = None) -> str:
        """The 95 % interval of the mean Recall@1 of all or some seeds, by the queries of one seed.

        Seeds may share their queries: more runs do not narrow it.
        """
        recalls = {seed: r for seed, r in self.values().items() if seeds is None or seed in seeds}
        queries = [counted(self.results[seed], self.over) for seed in recalls]
        return interval_text(statistics.fmean(recalls.values()), statistics.fmean(queries))


Stated = tuple[Hashable, Run, Mapping[str, Any]]
"""Values that a run states, by name, and the group within which all have to state the same."""


def results_at(run: Run, radius: float, method: str | None = None) -> list[Result]:
    """The run's results at a radius, of one method or of all.

    Raises DataError where a case was not evaluated at it, or the method was not at all.
    """
    cases: dict[Case | str, list[Result]] = {} if method is None else {method: []}
    for result in run.results:
        if method in (None, result.case.method):
            cases.setdefault(method or result.case, []).append(result)
    at_radius = []
    for case, results in cases.items():
        right = [result for result in results if math.isclose(result.radius_m, radius)]
        if not right:
            known = ", ".join(f"{r:g}" for r in sorted({result.radius_m for result in results}))
            raise DataError(
                f"radius {radius:g} m: no result of {case} in {run.folder}; radii evaluated "
                f"there: {known or 'none'}; choose one of them with `radius`, or evaluate at this "
                "radius (evaluation.radii)"
            )
        at_radius += right
    return at_radius


def seed_groups(
    results: Iterable[RunResult], over: Over, key: Callable[[RunResult], Hashable]
) -> list[SeedGroup]:
    """Results of one ``key`` as one row, in the order in which they come.

    Raises DataError for no result, an unknown ``over``, and two results of one row and seed
    that differ.
    """
    one_of("over", over, Over)
    groups: dict[Hashable, dict[int, RunResult]] = {}
    for each in results:
        seed = each.run.seed
        other = groups.setdefault(key(each), {}).setdefault(seed, each)
        # Two sweeps may share a row; on one machine it comes out the same to the last digit.
        if _rates(other.result) != _rates(each.result):
            raise DataError(
                f"{each.result.case}, seed {seed}: twice, with other figures: Recall@1 "
                f"{other.result.recall_1} in {other.run.folder}, {each.result.recall_1} in "
                f"{each.run.folder}; expected one run per seed; leave one of the two out of the "
                "paths, or delete it"
            )
    if not groups:
        raise DataError("runs: no result in any; expected at least one that has finished")
    return [_group(by_seed, over) for by_seed in groups.values()]


def _group(by_seed: Mapping[int, RunResult], over: Over) -> SeedGroup:
    first = next(iter(by_seed.values()))
    results = {seed: by_seed[seed].result for seed in sorted(by_seed)}
    return SeedGroup(first.result.case, first.setting, results, over)


def comparable(runs: Sequence[Run], stated: Iterable[Stated], *, mix: bool) -> list[str]:
    """Notes on what stands beside each other: the code's versions, and what is mixed.

    Raises DataError where runs state other values, without ``mix``; the key, its values and
    both run folders are named.
    """
    clash = first_clash(stated)
    if clash is None:
        return _about_commits(runs)
    if not mix:
        raise DataError(
            f"{clash}; expected runs on the same data under the same protocol, and means over "
            "runs with the same settings, since they are compared with each other; give runs that "
            "agree, or `mix` to see them side by side"
        )
    return [*_about_commits(runs), f"mixed, so that rows may not be comparable: {clash}"]


def first_clash(stated: Iterable[Stated]) -> str | None:
    """The first disagreement within a group, in words; None where all agree."""
    first: dict[Hashable, tuple[Run, Mapping[str, Any]]] = {}
    for group, run, now in stated:
        other, before = first.setdefault(group, (run, now))
        for key in sorted(before.keys() | now.keys()):
            if frozen(before.get(key)) != frozen(now.get(key)):
                return (
                    f"{key}: {before.get(key)!r} in {other.folder}, "
                    f"{now.get(key)!r} in {run.folder}"
                )
    return None


def counts(result: Result, where: str) -> dict[str, Any]:
    """The counts of a result, which must agree for one test and seed."""
    names = ("database", "queries", "answerable")
    return {f"results {name}{where}": getattr(result, name) for name in names}


def varied(rows: Iterable[SeedGroup]) -> list[str]:
    """Dotted keys whose values differ between rows, sorted."""
    settings = [row.setting for row in rows]
    keys = sorted({key for setting in settings for key in setting})
    return [key for key in keys if len({frozen(setting.get(key)) for setting in settings}) > 1]


def within(rows: Iterable[SeedGroup]) -> str:
    """When a place is right, and when wrong, for rows of one protocol."""
    result = next(result for row in rows for result in row.results.values())
    return within_text(result.radius_m, result.wrong_beyond_m)


def seeds_of(rows: Iterable[SeedGroup]) -> list[int]:
    """The seeds of any of the rows, in rising order."""
    return sorted({seed for row in rows for seed in row.results})


def same_seeds(rows: Iterable[SeedGroup]) -> bool:
    """Whether all rows are over the same seeds, and so the same data."""
    return len({frozenset(row.results) for row in rows}) == 1


def _repeated(key: str, flat: Mapping[str, Any]) -> bool:
    """Whether the key repeats for the method's raster what the config states for all methods."""
    common = key.removeprefix(_RASTER)
    of_all = common.startswith("preprocessing.") and common != key
    return of_all and frozen(flat.get(common)) == frozen(flat[key])


def _rates(result: Result) -> tuple[float, ...]:
    """The values that two equal results share; times are not among them."""
    return result.recall_1, result.recall_5, result.f1_max, result.auc, result.wrong_beyond_m


def _about_commits(runs: Iterable[Run]) -> list[str]:
    """A note where several versions of the code made them, else none."""
    numbers = Counter(commit for run in runs for commit in set(run.commits) or {"unknown"})
    if len(numbers) < 2:
        return []
    shown = ", ".join(
        f"{_short(commit)} ({number} run{'s' if number > 1 else ''})"
        for commit, number in numbers.items()
    )
    return [f"made by several versions of the code: commits {shown}"]


def _short(commit: str) -> str:
    """Seven digits, and '+' where the checkout had changes."""
    return commit if commit == "unknown" else commit[:7] + ("+" if commit.endswith("+") else "")

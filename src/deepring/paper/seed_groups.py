"""From the runs of a sweep to rows: runs that differ in nothing but the seed are one row.

Rows stand beside each other only where they were tested on the same data in the same way.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from deepring.errors import DeepringError
from deepring.evaluation.results import Result
from deepring.paper.flat import INDIFFERENT, flatten, frozen

#: The name of the trained network in the results of a training run.
TRAINED = "DeepRING"

#: The first radius of a config, by which the checkpoint was chosen.
HEADLINE = "evaluation.radii[0]"

#: Keys that cannot change what is learnt, among them what a run is compared with.
_IRRELEVANT = re.compile(
    INDIFFERENT
    + r"|(seed|checkpoint|methods|evaluate|overlap|evaluation\.(figures|descriptors))(\..*)?"
    r"|method\.(label|note)"
    r"|trainer\.(_target_|accelerator|log_every_n_steps|num_sanity_val_steps|profiler"
    r"|enable_.*|deterministic|default_root_dir|logger|callbacks)"
)

#: The method's preprocessing, which follows the config's unless it is set apart.
_RASTER = "method.raster."

#: What must agree between runs that are compared. Where the data lie may go with the seed.
_PROTOCOL = re.compile(r"(data|train_data|test_data|preprocessing|evaluation)\..*")
_ROOT = re.compile(r"(data|(train|test)_data\.[^.]+)\.root")

#: What the results of one seed count, which must agree beside the data's place.
COUNTED = ("database", "queries", "answerable")


@dataclass(frozen=True, eq=False)
class Run:
    """A finished training run."""

    folder: str
    config: Mapping[str, Any]
    """Resolved, of plain dicts, lists and values."""
    results: Sequence[Result]
    commits: Sequence[str] = ()
    """Of the code that made it, several where it went on with other code."""
    seconds: float | None = None
    """That the training took; None where nothing was trained, or nobody noted it."""


class Origin(Protocol):
    """Where a part of a table comes from."""

    @property
    def folder(self) -> str:
        """The run's."""
        ...

    @property
    def seed(self) -> int:
        """The run's."""
        ...


_Origin = TypeVar("_Origin", bound=Origin)


@dataclass(frozen=True, eq=False)
class Row:
    """The runs of one configuration."""

    setting: Mapping[str, Any]
    """Dotted config keys to values; absent where null."""
    results: Mapping[int, Result]
    """A result for each seed, in rising order."""


@dataclass(frozen=True, eq=False)
class Rows:
    """All rows, the dotted keys of protocol that differ between them, and what is to be said."""

    rows: list[Row]
    mixed: list[str]
    notes: list[str]


@dataclass(frozen=True, eq=False)
class _Part:
    """A run as it enters a row."""

    folder: str
    seed: int
    setting: dict[str, Any]
    roots: dict[str, Any]
    result: Result

    @property
    def protocol(self) -> dict[str, Any]:
        return {key: value for key, value in self.setting.items() if _PROTOCOL.fullmatch(key)}

    @property
    def counted(self) -> dict[str, Any]:
        where = {f"results {name}": getattr(self.result.case, name) for name in ("test", "region")}
        return where | {f"results {name}": getattr(self.result, name) for name in COUNTED}


def collect_rows(runs: Sequence[Run], radius: float = 10.0, *, mix: bool = False) -> Rows:
    """Runs that differ in nothing but the seed as one row, in the order in which they come.

    Args:
        runs: finished runs, each with a result of the trained network.
        radius: metres; the results at this radius are taken.
        mix: let runs on different data or under different protocols stand beside each other.

    Raises:
        DeepringError: no run, no result at this radius, two runs of one row and seed with other
            results, or, without ``mix``, runs whose data or protocols differ; the key, its values
            and both run folders are named.
    """
    if not runs:
        raise DeepringError("runs: none given; expected at least one that has finished")
    parts = [_part(run, radius) for run in runs]
    notes = about_commits(runs)
    if mix:
        parts, more = _mixed(parts)
        notes += more
    else:
        _refuse_mixture(parts)
    return Rows(_rows(parts), _varied([part.protocol for part in parts]), notes)


def varied(rows: Sequence[Row]) -> list[str]:
    """Dotted keys whose values differ between rows, sorted."""
    return _varied([row.setting for row in rows])


def seed_of(run: Run) -> int:
    """The seed of its config. Raises DeepringError where that is no whole number."""
    seed = run.config.get("seed")
    if not isinstance(seed, int):
        raise DeepringError(
            f"{run.folder}: seed {seed!r} in its config; expected a whole number; "
            "leave this folder out"
        )
    return seed


def setting_of(run: Run) -> dict[str, Any]:
    """Dotted keys to values of its config, without those that cannot change what is learnt."""
    flat = flatten(run.config)
    return {
        key: value
        for key, value in flat.items()
        if not _IRRELEVANT.fullmatch(key) and not _repeated(key, flat)
    }


def _repeated(key: str, flat: Mapping[str, Any]) -> bool:
    """Whether the key says of the method's raster what the config says of all methods'."""
    common = key.removeprefix(_RASTER)
    of_all = common.startswith("preprocessing.") and common != key
    return of_all and frozen(flat.get(common)) == frozen(flat[key])


def _part(run: Run, radius: float) -> _Part:
    seed, setting = seed_of(run), setting_of(run)
    # The other radii are counted besides, and change nothing.
    radii = setting.pop("evaluation.radii", None)
    if radii:
        setting[HEADLINE] = radii[0]
    roots = {key: setting.pop(key) for key in list(setting) if _ROOT.fullmatch(key)}
    return _Part(run.folder, seed, setting, roots, _result(run, radius))


def _result(run: Run, radius: float) -> Result:
    own = [result for result in run.results if result.case.method == TRAINED]
    found = [result for result in own if math.isclose(result.radius_m, radius)]
    if len(found) == 1:
        return found[0]
    known = ", ".join(f"{r:g}" for r in sorted({result.radius_m for result in own})) or "none"
    raise DeepringError(
        f"radius {radius:g} m: {len(found)} results of {TRAINED} in {run.folder}; expected one; "
        f"radii evaluated there: {known}; choose one of them with `radius`, or evaluate at this "
        "radius (evaluation.radii)"
    )


def _rows(parts: Iterable[_Part]) -> list[Row]:
    groups: dict[str, dict[int, _Part]] = {}
    for part in parts:
        group = groups.setdefault(frozen(part.setting), {})
        other = group.setdefault(part.seed, part)
        # Two sweeps may share a row; on one machine it comes out the same to the last digit.
        if rates(other.result) != rates(part.result):
            raise DeepringError(
                f"seed {part.seed} of one configuration twice, with other results: {other.folder} "
                f"and {part.folder}; expected one run a seed; leave one of the two out of the "
                "paths, or delete it"
            )
    return [
        Row(
            next(iter(group.values())).setting,
            {seed: group[seed].result for seed in sorted(group)},
        )
        for group in groups.values()
    ]


def rates(result: Result) -> tuple[float, ...]:
    """What tells whether two results are the same one: the times are not among them."""
    return result.recall_1, result.recall_5, result.f1_max, result.auc


def _refuse_mixture(parts: Sequence[_Part]) -> None:
    clash = (
        clash_of(parts, lambda part: part.protocol)
        or clash_of(parts, lambda part: part.roots, lambda part: part.seed)
        or clash_of(parts, lambda part: part.counted, lambda part: part.seed)
    )
    if clash:
        raise DeepringError(
            f"{clash}; expected runs on the same data under the same protocol, since rows are "
            "compared with each other; give runs that agree, or `mix` to see them side by side"
        )


def _mixed(parts: Sequence[_Part]) -> tuple[list[_Part], list[str]]:
    """Parts whose setting names the data's place where it differs within a seed, and notes."""

    def alike(part: _Part) -> Hashable:
        return part.seed, frozen(part.protocol)

    if clash_of(parts, lambda part: part.roots, alike):
        parts = [
            _Part(part.folder, part.seed, part.setting | part.roots, part.roots, part.result)
            for part in parts
        ]
    clash = clash_of(parts, lambda part: part.counted, alike)
    notes = ["data and protocols are mixed: rows may not be comparable"]
    return list(parts), notes + ([f"counted differently: {clash}"] if clash else [])


def clash_of(
    parts: Iterable[_Origin],
    values: Callable[[_Origin], Mapping[str, Any]],
    group: Callable[[_Origin], Hashable] = lambda _: None,
) -> str | None:
    """The first disagreement within a group, in words; None where all agree.

    The seed is named with it, unless all parts are one group.
    """
    first: dict[Hashable, _Origin] = {}
    for part in parts:
        other = first.setdefault(group(part), part)
        before, now = values(other), values(part)
        for key in sorted(before.keys() | now.keys()):
            if frozen(before.get(key)) != frozen(now.get(key)):
                within = f" (seed {part.seed})" if group(part) is not None else ""
                return (
                    f"{key}{within}: {before.get(key)!r} in {other.folder}, "
                    f"{now.get(key)!r} in {part.folder}"
                )
    return None


def _varied(settings: Collection[Mapping[str, Any]]) -> list[str]:
    keys = sorted({key for setting in settings for key in setting})
    return [key for key in keys if len({frozen(setting.get(key)) for setting in settings}) > 1]


def about_commits(runs: Iterable[Run]) -> list[str]:
    """A note where several versions of the code made them, else none."""
    counts = Counter(commit for run in runs for commit in set(run.commits) or {"unknown"})
    if len(counts) < 2:
        return []
    shown = ", ".join(
        f"{_short(commit)} ({count} run{'s' if count > 1 else ''})"
        for commit, count in counts.items()
    )
    return [f"made by several versions of the code: commits {shown}"]


def _short(commit: str) -> str:
    """Seven digits, and '+' where the checkout had changes."""
    return commit if commit == "unknown" else commit[:7] + ("+" if commit.endswith("+") else "")

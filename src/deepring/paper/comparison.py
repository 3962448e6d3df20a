"""The paper's comparison of methods from the runs of a sweep: Table I, Table II, what crossing
costs, and what each method takes.
"""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from deepring.evaluation.metrics import Over
from deepring.paper.comparison_blocks import Block, Name, blocks_of, paper_of, seeds_of
from deepring.paper.comparison_notes import block_notes, remark_notes
from deepring.paper.comparison_results import Tested, collect
from deepring.paper.comparison_values import FAMILIES, Rates, family, place_of
from deepring.paper.seed_groups import Run, setting_of

_TITLES: dict[Name, str] = {
    "table1": "In-domain comparison, test region (the paper's Table I)",
    "table2": "Cross-domain comparison, whole drives (the paper's Table II)",
    "further": "Further test sets, on which nothing was trained",
}


@dataclass(frozen=True, eq=False)
class ComparisonTable:
    """Table I, Table II, or that of further test sets."""

    name: Name
    title: str
    blocks: Sequence[Block]
    notes: Sequence[str]

    def paper(self, row: Tested) -> Rates | None:
        """The paper's values of a row, where it has any."""
        return paper_of(self.name, row)


@dataclass(frozen=True, eq=False)
class Crossing:
    """Recall@1 of one method on one test region, trained there and trained elsewhere."""

    method: str
    test: str
    elsewhere: str
    """What it was trained on instead."""
    in_domain: Mapping[int, float]
    crossed: Mapping[int, float]
    """Seed to Recall@1, both of the seeds that have both, in rising order."""

    @property
    def difference(self) -> dict[int, float]:
        """Crossed minus in-domain, seed by seed."""
        return {seed: value - self.in_domain[seed] for seed, value in self.crossed.items()}


@dataclass(frozen=True, eq=False)
class Cost:
    """What one method takes."""

    method: str
    seconds_per_scan: float
    """Median over all its results, as the next."""
    seconds_per_query: float
    minutes: float | None
    """Mean training time; None where nothing was trained, or nobody noted it."""
    seeds: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """Everything that a comparison shows."""

    tables: Sequence[ComparisonTable]
    """Those that hold anything, Table I first."""
    crossings: Sequence[Crossing]
    costs: Sequence[Cost]
    tested: Sequence[Tested]
    """By test and in the paper's order, those too that stand in no table."""
    radius: float
    over: Over
    notes: Sequence[str]
    """On all of it: the code's versions, what is mixed, what was left out."""

    @property
    def conditions(self) -> str:
        """What stands behind every title."""
        return f"right within {self.radius:g} m, recall over {self.over} queries"


def is_comparison(runs: Iterable[Run]) -> bool:
    """Whether methods are to be compared, not the settings of DeepRING.

    They are where some run is of another method than DeepRING by its ``method._target_``, or was
    tested in several places.
    """
    return any(
        _method_class(run) != "DeepRing" or len({r.case.place for r in run.results}) > 1
        for run in runs
    )


def compare(
    runs: Sequence[Run],
    radius: float = 10.0,
    over: Over = "answerable",
    *,
    mix: bool = False,
    notes: Sequence[str] = (),
) -> Comparison:
    """Tables I and II, further test sets, what crossing costs, and what each method takes.

    Args:
        runs: finished runs of several methods, trainings and seeds.
        radius: metres; the results at this radius are shown.
        over: recall as the share of the answerable queries, or of all.
        mix: let runs on different data or under different protocols stand beside each other.
        notes: further notes to stand below the tables.

    Raises:
        DeepringError: as `collect`.
    """
    found = collect(runs, radius, over, mix=mix)
    tested = sorted(found.tested, key=_order)
    shared = [*found.notes, *notes]
    blocks = blocks_of(tested)
    remarks = remark_notes([block for each in blocks.values() for block in each], found.remarks)
    tables = []
    for name, title in _TITLES.items():
        if blocks[name]:
            own = [*block_notes(name, blocks[name]), *remarks, *shared]
            tables.append(ComparisonTable(name, title, blocks[name], own))
            remarks = []  # below the first table alone
    crossings, costs = _crossings(tested), _costs(tested, found.minutes)
    return Comparison(tables, crossings, costs, tested, radius, over, shared)


def _method_class(run: Run) -> str:
    return str(setting_of(run).get("method._target_")).rpartition(".")[2]


def _order(row: Tested) -> tuple[int, str, str, tuple[int, str], str]:
    """The paper's NCLT before its MulRan and both before the rest; then its order of methods."""
    case = row.case
    known = [*FAMILIES, None].index(family(case.test))
    return known, case.test, case.region, place_of(case.method), case.train


def _crossings(tested: Sequence[Tested]) -> list[Crossing]:
    """Of the test region, so that the same queries are counted both times."""
    known = {row.case: row for row in tested}
    found = []
    for row in tested:
        case = row.case
        home = known.get(replace(case, train=case.test))
        if case.crosses and case.region == "test" and home is not None:
            own, away = home.values("recall_1"), row.values("recall_1")
            both = [seed for seed in own if seed in away]
            in_domain, crossed = ({seed: recalls[seed] for seed in both} for recalls in (own, away))
            if both:
                found.append(Crossing(case.method, case.test, case.train, in_domain, crossed))
    return found


def _costs(tested: Iterable[Tested], minutes: Mapping[str, float]) -> list[Cost]:
    methods: dict[str, list[Tested]] = {}
    for row in tested:
        methods.setdefault(row.case.method, []).append(row)
    costs = []
    for method in sorted(methods, key=place_of):
        rows = methods[method]
        results = [result for row in rows for result in row.results.values()]
        scan = statistics.median(result.seconds_per_scan for result in results)
        query = statistics.median(result.seconds_per_query for result in results)
        costs.append(Cost(method, scan, query, minutes.get(method), len(seeds_of(rows))))
    return costs

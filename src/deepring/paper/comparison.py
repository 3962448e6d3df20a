"""The paper's comparison of methods from the runs of a sweep: what stands in Table I and Table II.

A block holds the rows of one test, which are compared with each other.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from deepring.evaluation.case import Case
from deepring.evaluation.metrics import Over
from deepring.paper.ablation_results import learnt_by
from deepring.paper.comparison_results import collect_cases, remarks_of, training_minutes
from deepring.paper.flat import frozen
from deepring.paper.paper_values import FAMILIES, Rates, family, paper_rates, place_of
from deepring.paper.seed_groups import Run, SeedGroup, within

Name = Literal["table1", "table2", "further"]
Block = Sequence[SeedGroup]


@dataclass(frozen=True, eq=False)
class MethodComparison:
    """Everything that a comparison shows."""

    blocks: Mapping[Name, Sequence[Block]]
    """The tables with any rows, Table I first."""
    rows: Sequence[SeedGroup]
    """By test and in the paper's order, those too that stand in no table."""
    remarks: Mapping[str, Sequence[str]]
    """Method to what its configs say in ``method.note``."""
    minutes: Mapping[str, float]
    """Method to its mean training time, where that was noted."""
    radius: float
    over: Over
    notes: Sequence[str]
    """On all of it: the code's versions, what is mixed, what was left out."""

    @property
    def conditions(self) -> str:
        """The words behind every title."""
        return f"{within(self.rows)}, recall over {self.over} queries"


def is_comparison(runs: Sequence[Run]) -> bool:
    """Whether the runs compare methods rather than settings of DeepRING.

    They do where some run is of another method than DeepRING by its ``method._target_``, or
    evaluates a checkpoint beside other methods, or where runs of one setting were tested in several
    places.
    """
    several = any(len({result.case.place for result in run.results}) > 1 for run in runs)
    return (several and len({frozen(learnt_by(run)) for run in runs}) == 1) or any(
        str(run.setting.get("method._target_")).rpartition(".")[2] != "DeepRing"
        or run.config.get("checkpoint") is not None
        for run in runs
    )


def compare(
    runs: Sequence[Run],
    radius: float = 10.0,
    over: Over = "answerable",
    *,
    mix: bool = False,
    notes: Sequence[str] = (),
) -> MethodComparison:
    """Tables I and II, further test sets, and the cost of each method.

    Args:
        runs: finished runs of several methods, trainings and seeds.
        radius: metres; the results at this radius are shown.
        over: recall as the share of the answerable queries, or of all.
        mix: let runs on different data or under different protocols stand beside each other.
        notes: further notes to stand below the tables.

    Raises:
        DeepringError: as `deepring.paper.comparison_results.collect_cases`.
    """
    groups, shared = collect_cases(runs, radius, over, mix=mix)
    rows = sorted(groups, key=_order)
    blocks = {name: blocks for name, blocks in blocks_of(rows).items() if blocks}
    minutes = training_minutes(runs)
    return MethodComparison(
        blocks, rows, remarks_of(runs), minutes, radius, over, [*shared, *notes]
    )


def blocks_of(rows: Sequence[SeedGroup]) -> dict[Name, list[Block]]:
    """The blocks of each table, in the order in which their first rows come.

    Table I holds what was trained and tested on one dataset, in its test region. Table II holds
    what was trained elsewhere and tested on the whole of a dataset that others were trained on.
    A method that learns nothing stands in both. Tests on datasets that nothing was trained on are
    further test sets. Some rows stand nowhere.
    """
    cases = [row.case for row in rows]
    known = {name for case in cases for name in case.train.split("+") if name}
    at_home = {case.test for case in cases if case.region == "test" and case.in_domain}
    away = {case.test for case in cases if case.region == "whole" and case.crosses}

    def in_table1(case: Case) -> bool:
        fits = case.in_domain or not case.train
        return fits and case.region == "test" and case.test in at_home

    def in_table2(case: Case) -> bool:
        fits = case.crosses or not case.train
        return fits and case.region == "whole" and case.test in away & known

    return {
        "table1": _blocks(rows, in_table1),
        "table2": _blocks(rows, in_table2),
        "further": _blocks(rows, lambda case: case.test not in known),
    }


def paper_of(name: Name, row: SeedGroup) -> Rates | None:
    """The paper's values of a row of this table, where it has any."""
    return paper_rates(name, row.case.test, row.case.method)


def _blocks(rows: Iterable[SeedGroup], holds: Callable[[Case], bool]) -> list[Block]:
    groups: dict[tuple[str, str], list[SeedGroup]] = {}
    for row in rows:
        if holds(row.case):
            groups.setdefault((row.case.test, row.case.region), []).append(row)
    return list(groups.values())


def _order(row: SeedGroup) -> tuple[int, str, str, tuple[int, str], str]:
    """The paper's NCLT before its MulRan and both before the rest; then its order of methods."""
    case = row.case
    known = [*FAMILIES, None].index(family(case.test))
    return known, case.test, case.region, place_of(case.method), case.train

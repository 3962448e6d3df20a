"""Which results stand beside each other: a block a test, in the table that it belongs to."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from deepring.evaluation.case import Case
from deepring.paper.comparison_results import Tested
from deepring.paper.comparison_values import Rates, Table, paper_rates

Name = Literal["table1", "table2", "further"]


@dataclass(frozen=True, eq=False)
class Block:
    """The rows of one test, which are compared with each other."""

    test: str
    region: str
    rows: Sequence[Tested]

    @property
    def place(self) -> str:
        """'sim_nclt test'."""
        return f"{self.test} {self.region}".strip()

    @property
    def seeds(self) -> list[int]:
        """Those of any row."""
        return seeds_of(self.rows)

    @property
    def alike(self) -> bool:
        """Whether all rows are over the same seeds, and so the same data."""
        return len({frozenset(row.results) for row in self.rows}) == 1


def blocks_of(tested: Sequence[Tested]) -> dict[Name, list[Block]]:
    """The blocks of each table, in the order in which their first rows come.

    Table I holds what was trained and tested on one dataset, in its test region. Table II holds
    what was trained elsewhere and tested on the whole of a dataset that others were trained on.
    A method that learns nothing stands in both. Tests on datasets that nothing was trained on are
    further test sets. Some rows stand nowhere.
    """
    known = {name for row in tested for name in row.case.train.split("+") if name}
    at_home = {row.case.test for row in tested if _is(row.case, "test") and row.case.in_domain}
    away = {row.case.test for row in tested if _is(row.case, "whole") and row.case.crosses}

    def in_table1(case: Case) -> bool:
        fits = case.in_domain or not case.train
        return fits and _is(case, "test") and case.test in at_home

    def in_table2(case: Case) -> bool:
        fits = case.crosses or not case.train
        return fits and _is(case, "whole") and case.test in away & known

    return {
        "table1": _blocks(tested, in_table1),
        "table2": _blocks(tested, in_table2),
        "further": _blocks(tested, lambda case: case.test not in known),
    }


def paper_of(name: Name, row: Tested) -> Rates | None:
    """The paper's values of a row of this table, where it has any."""
    tables: dict[Name, Table] = {"table1": "table1", "table2": "table2"}
    case = row.case
    return paper_rates(tables[name], case.test, case.method) if name in tables else None


def seeds_of(rows: Iterable[Tested]) -> list[int]:
    """The seeds of any of the rows, in rising order."""
    return sorted({seed for row in rows for seed in row.results})


def _is(case: Case, region: str) -> bool:
    return case.region == region


def _blocks(tested: Iterable[Tested], holds: Callable[[Case], bool]) -> list[Block]:
    groups: dict[tuple[str, str], list[Tested]] = {}
    for row in tested:
        if holds(row.case):
            groups.setdefault((row.case.test, row.case.region), []).append(row)
    return [Block(test, region, rows) for (test, region), rows in groups.items()]

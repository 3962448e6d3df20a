"""Which differences between methods are more than chance: McNemar's test on the same queries."""

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from deepring.evaluation.case import Case
from deepring.evaluation.matches import TopMatches
from deepring.evaluation.paired import Paired, paired, same_queries
from deepring.paper.comparison import Block, MethodComparison
from deepring.paper.seed_groups import SeedGroup, same_seeds
from deepring.reports.table import NONE, Cell, Table, full_text

Retrieved = Mapping[tuple[Case, int], TopMatches]
"""What was retrieved in one test with one seed."""


class Pair(NamedTuple):
    """Two rows of one test, the one of the higher mean recall first."""

    one: SeedGroup
    other: SeedGroup
    seeds: Mapping[int, Paired]
    """By seed, those for which both have their retrievals, of the same queries."""


def retrieved_by_case(retrieved: Iterable[tuple[int, TopMatches]]) -> Retrieved:
    """The first matches of each case and seed."""
    found: dict[tuple[Case, int], TopMatches] = {}
    for seed, matches in retrieved:
        found.setdefault((matches.case, seed), matches)
    return found


def pairs_of(comparison: MethodComparison, retrieved: Retrieved) -> list[list[Pair]]:
    """The pairs of rows of each test, the best row's first."""
    tests: dict[tuple[str, str], Block] = {}
    for block in [block for blocks in comparison.blocks.values() for block in blocks]:
        tests.setdefault((block[0].case.test, block[0].case.region), block)
    return [list(_pairs(block, retrieved, comparison.radius)) for block in tests.values()]


def shown_pairs(tests: Sequence[Sequence[Pair]], comparison: MethodComparison) -> Table | None:
    """Each test's best row against the others; None where no two have their retrievals."""
    cells: list[list[Cell]] = []
    breaks = []
    for pairs in tests:
        with_best = [pair for pair in pairs if pair.one is pairs[0].one and pair.seeds]
        if cells and with_best:
            breaks.append(len(cells))
        for number, pair in enumerate(with_best):
            case, each = pair.one.case, pair.seeds.values()
            texts = ["" if number else case.place, _label(pair.one), _label(pair.other)]
            for counts in (
                [one.queries for one in each],
                [one.one_alone for one in each],
                [one.other_alone for one in each],
            ):
                texts.append(_listed(map(str, counts)))
            cells.append([*map(Cell, [*texts, _listed(p_text(one.p) for one in each)])])
    if not cells:
        return None
    return Table(
        f"Paired, the best against each other (McNemar, exact): {comparison.conditions}",
        ["Dataset", "one", "other", "answerable", "one alone", "other alone", "p"],
        cells,
        3,
        breaks,
        [
            "queries that one answers rightly and the other does not, and how probable so uneven a "
            "split is if both are equally good; a number for each seed",
            "p is of one comparison: of twenty, one falls below 0.05 by chance",
            "where a number lacks, the two were asked other queries, or have no retrievals",
        ],
    )


def number_table(tests: Sequence[Sequence[Pair]]) -> Table:
    """Every pair of rows and every seed, with p in full."""
    names = ["test", "region", "one", "one_train", "other", "other_train", "seed"]
    cells = []
    for pair in [pair for pairs in tests for pair in pairs]:
        case = pair.one.case
        for seed, one in pair.seeds.items():
            trained = [(row.case.method, row.case.train) for row in (pair.one, pair.other)]
            texts = [case.test, case.region, *trained[0], *trained[1], str(seed)]
            texts += map(str, (one.queries, one.one_alone, one.other_alone))
            cells.append([*map(Cell, [*texts, full_text(one.p)])])
    counts = ("answerable", "one_alone", "other_alone", "p")
    return Table("Paired", [*names, *counts], cells, len(names))


def p_text(p: float) -> str:
    """Two digits that count.

    >>> p_text(0.0390625), p_text(1.0), p_text(3.2e-9)
    ('0.039', '1', '3.2e-09')
    """
    return f"{p:.2g}"


def _pairs(block: Block, retrieved: Retrieved, radius: float) -> Iterator[Pair]:
    rows = sorted(block, key=lambda row: -statistics.fmean(row.values().values()))
    rows = rows if same_seeds(rows) else list(block)
    for one, other in combinations(rows, 2):
        both = {
            seed: (retrieved.get((one.case, seed)), retrieved.get((other.case, seed)))
            for seed in one.results
        }
        compared = {
            seed: paired(first, second, radius)
            for seed, (first, second) in both.items()
            if first is not None and second is not None and same_queries(first, second)
        }
        yield Pair(one, other, compared)


def _label(row: SeedGroup) -> str:
    return f"{row.case.method} ({row.case.trained_on})" if row.case.train else row.case.method


def _listed(texts: Iterable[str]) -> str:
    return " ".join(texts) or NONE

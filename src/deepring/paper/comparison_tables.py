"""The tables of a comparison as texts: as the paper prints them, and in full for the CSV file."""

import statistics
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby

from deepring.paper.ablation import sample_deviation
from deepring.paper.comparison import Comparison, ComparisonTable, Cost, Crossing
from deepring.paper.comparison_blocks import Block, seeds_of
from deepring.paper.comparison_notes import about_means
from deepring.paper.comparison_values import Rates
from deepring.reports.table import NONE, Cell, Table, best_bold

#: The headers of the metrics that the paper shows.
_SHOWN = {"recall_1": "Recall@1", "f1_max": "F1", "auc": "AUC"}
_METRICS = ("recall_1", "recall_5", "f1_max", "auc")


def shown_tables(comparison: Comparison) -> dict[str, Table]:
    """File name to table: table1, table2, further, crossing and costs, those that hold anything.

    Means to three digits; the best of a test is bold where all its rows are over the same seeds.
    """
    tables: dict[str, Table] = {}
    for table in comparison.tables:
        tables[table.name] = _methods_table(table, f"{table.title}: {comparison.conditions}")
    if comparison.crossings:
        tables["crossing"] = _crossing_table(comparison)
    return tables | {"costs": _costs_table(comparison.costs)}


def number_table(comparison: Comparison) -> Table:
    """Every number in full, a row for each that was tested; "" where there is none.

    Beside what was trained and tested where: the table that holds it; radius; n and the seeds;
    mean and sample standard deviation of each metric; the paper's values; Recall@1 of each seed.
    """
    names = ["method", "train", "test", "region", "table"]
    spread = [f"{metric}_{of}" for metric in _METRICS for of in ("mean", "std")]
    paper = [f"paper_{metric}" for metric in Rates._fields]
    seeds = seeds_of(comparison.tested)
    by_seed = [f"recall_1_seed_{seed}" for seed in seeds]
    holding = {row: table for table in comparison.tables for b in table.blocks for row in b.rows}
    cells = []
    for row in comparison.tested:
        table = holding.get(row)
        texts = [*row.case.columns.values(), table.name if table else ""]
        texts += [repr(comparison.radius), comparison.over]
        texts += [str(len(row.results)), " ".join(map(str, row.results))]
        for metric in _METRICS:
            values = row.values(metric).values()
            texts += [_full(statistics.fmean(values)), _full(sample_deviation(values))]
        rates = table.paper(row) if table else None
        texts += map(_full, rates or [None] * len(paper))
        texts += [_full(row.values("recall_1").get(seed)) for seed in seeds]
        cells.append([*map(Cell, texts)])
    headers = [*names, "radius_m", "over", "n", "seeds", *spread, *paper, *by_seed]
    return Table("Comparison", headers, cells, len(names))


def _methods_table(table: ComparisonTable, title: str) -> Table:
    rows = [row for block in table.blocks for row in block.rows]
    trainings = {(row.case.method, row.case.test, row.case.train) for row in rows}
    ambiguous = len(trainings) > len({training[:2] for training in trainings})
    names = ["Dataset", "Approach"]
    if table.name == "further" or ambiguous:
        names.append("trained on")
    with_paper = any(table.paper(row) for row in rows)
    values = [_values(table, block, with_paper) for block in table.blocks]
    cells = [
        [*map(Cell, _names(table, block, number)[: len(names)]), *columns]
        for block, lines in zip(table.blocks, values, strict=True)
        for number, columns in enumerate(lines)
    ]
    headers = [h for shown in _SHOWN.values() for h in (shown, "paper")[: 1 + with_paper]]
    breaks = _starts([len(block.rows) for block in table.blocks])
    return Table(title, [*names, *headers], cells, len(names), breaks, table.notes)


def _names(table: ComparisonTable, block: Block, number: int) -> list[str]:
    """What a row is; a dataset is named once."""
    case = block.rows[number].case
    dataset = block.place if table.name == "further" else block.test
    return ["" if number else dataset, case.method, case.train or NONE]


def _values(table: ComparisonTable, block: Block, with_paper: bool) -> Iterable[tuple[Cell, ...]]:
    """The rows of a block: each metric, the paper's beside it."""
    columns = []
    for metric in _SHOWN:
        texts = [_spread(row.values(metric).values()) for row in block.rows]
        columns.append(best_bold(texts, max if block.alike else None))
        if with_paper:
            rates = [table.paper(row) for row in block.rows]
            columns.append([Cell(_rate(r and getattr(r, metric))) for r in rates])
    return zip(*columns, strict=True)


def _crossing_table(comparison: Comparison) -> Table:
    names = ["Dataset", "Approach", "trained elsewhere on"]
    cells: list[list[Cell]] = []
    sizes = []
    for test, group in groupby(comparison.crossings, key=lambda crossing: crossing.test):
        rows = list(group)
        best = max if len({frozenset(row.crossed) for row in rows}) == 1 else None
        columns = [
            best_bold([_spread(row.in_domain.values()) for row in rows], best),
            best_bold([_spread(row.crossed.values()) for row in rows], best),
            best_bold([_spread(row.difference.values(), "+") for row in rows], best),
        ]
        for number, (row, *values) in enumerate(zip(rows, *columns, strict=True)):
            own = ["" if number else test, row.method, row.elsewhere]
            cells.append([*map(Cell, own), *values])
        sizes.append(len(rows))
    return Table(
        f"What crossing costs, Recall@1 on the same test region: {comparison.conditions}",
        [*names, "in-domain", "crossed", "difference"],
        cells,
        len(names),
        _starts(sizes),
        [*_about_crossings(comparison.crossings), *comparison.notes],
    )


def _about_crossings(crossings: Sequence[Crossing]) -> list[str]:
    """What the values are means of, by its seeds where rows have different ones."""
    means: dict[str, list[str]] = {}
    for row in crossings:
        name = f"{row.method} on {row.test}"
        means.setdefault(about_means(list(row.crossed)), []).append(name)
    if len(means) == 1:
        return list(means)
    return [f"{note}: {', '.join(names)}" for note, names in means.items()]


def _costs_table(costs: Sequence[Cost]) -> Table:
    cells = [
        [
            Cell(cost.method),
            Cell(_three_digits(cost.seconds_per_scan * 1e3)),
            Cell(_three_digits(cost.seconds_per_query * 1e3)),
            Cell(NONE if cost.minutes is None else _three_digits(cost.minutes)),
            Cell(str(cost.seeds)),
        ]
        for cost in costs
    ]
    return Table(
        "Costs",
        ["Approach", "ms/scan", "ms/query", "training (min)", "seeds"],
        cells,
        1,
        notes=[
            "ms/scan from points to descriptor, ms/query to search the whole database: medians "
            "over all tests; training: mean over runs",
            "measured on whatever machine made the runs, with whatever ran beside them",
        ],
    )


def _starts(sizes: Sequence[int]) -> list[int]:
    """The rows at which all blocks but the first begin."""
    return [sum(sizes[:number]) for number in range(1, len(sizes))]


def _spread(values: Collection[float], sign: str = "") -> str:
    """'0.859 ± 0.010', or '0.859' for one seed."""
    deviation = sample_deviation(values)
    mean = f"{statistics.fmean(values):{sign}.3f}"
    return mean if deviation is None else f"{mean} ± {deviation:.3f}"


def _rate(value: float | None) -> str:
    return NONE if value is None else f"{value:.3f}"


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"


def _full(value: float | None) -> str:
    return "" if value is None else repr(value)

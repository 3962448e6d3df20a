"""The tables of a comparison as texts: as the paper prints them, and in full for the CSV file."""

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby

from deepring.evaluation.case import Case
from deepring.evaluation.results import RECALLS
from deepring.paper.comparison import Block, MethodComparison, Name, paper_of
from deepring.paper.comparison_notes import about_groups, block_notes, remark_notes
from deepring.paper.paper_values import Rates, place_of
from deepring.paper.seed_groups import ABOUT_INTERVALS, SeedGroup, same_seeds, seeds_of
from deepring.paper.seed_words import mean_text, sample_deviation
from deepring.reports.table import NONE, Cell, Table, best_bold, full_text, rate_text, short_text

_TITLES: dict[Name, str] = {
    "table1": "In-domain comparison, test region (the paper's Table I)",
    "table2": "Cross-domain comparison, whole drives (the paper's Table II)",
    "further": "Further test sets, on which nothing was trained",
}

#: The headers of the metrics that the paper shows.
_SHOWN = {"recall_1": "Recall@1", "f1_max": "F1", "auc": "AUC"}
_METRICS = (*RECALLS, "f1_max", "auc", "ap")


def shown_tables(comparison: MethodComparison) -> dict[str, Table]:
    """File name to table: table1, table2, further, crossing and costs, those that hold anything.

    Means to three digits; the best of a test is bold where all its rows are over the same seeds.
    """
    tables: dict[str, Table] = {}
    every = [block for blocks in comparison.blocks.values() for block in blocks]
    remarks = remark_notes(every, comparison.remarks)
    for name, blocks in comparison.blocks.items():
        notes = [*block_notes(name, blocks), ABOUT_INTERVALS, *remarks, *comparison.notes]
        remarks = []  # below the first table alone
        tables[name] = _methods_table(name, blocks, comparison.conditions, notes)
    if crossings := _crossings(comparison.rows):
        tables["crossing"] = _crossing_table(crossings, comparison)
    return tables | {"costs": _costs_table(comparison)}


def number_table(comparison: MethodComparison) -> Table:
    """Every number in full, a row for each that was tested; "" where there is none.

    Beside what was trained and tested where: the table that holds it; radius; n and the seeds;
    mean and sample standard deviation of each metric; the paper's values; Recall@1 of each seed
    with its 95 % interval.
    """
    names = ["method", "train", "test", "region", "table"]
    spread = [f"{metric}_{of}" for metric in _METRICS for of in ("mean", "std")]
    paper = [f"paper_{metric}" for metric in Rates._fields]
    seeds = seeds_of(comparison.rows)
    by_seed = [f"recall_1_seed_{seed}{end}" for seed in seeds for end in ("", "_low", "_high")]
    table_of = {
        row: name for name, blocks in comparison.blocks.items() for block in blocks for row in block
    }
    cells = []
    for row in comparison.rows:
        name = table_of.get(row)
        texts = [*row.case.columns.values(), name or ""]
        texts += [repr(comparison.radius), comparison.over]
        texts += [str(len(row.results)), " ".join(map(str, row.results))]
        for metric in _METRICS:
            values = row.values(metric).values()
            texts += [full_text(statistics.fmean(values)), full_text(sample_deviation(values))]
        rates = paper_of(name, row) if name else None
        texts += map(full_text, rates or [None] * len(paper))
        texts += [full_text(number) for seed in seeds for number in row.with_interval(seed)]
        cells.append([*map(Cell, texts)])
    headers = [*names, "radius_m", "over", "n", "seeds", *spread, *paper, *by_seed]
    return Table("Comparison", headers, cells, len(names))


def _methods_table(
    name: Name, blocks: Sequence[Block], conditions: str, notes: Sequence[str]
) -> Table:
    rows = [row for block in blocks for row in block]
    trainings = {(row.case.method, row.case.test, row.case.train) for row in rows}
    ambiguous = len(trainings) > len({training[:2] for training in trainings})
    names = ["Dataset", "Approach"]
    if name == "further" or ambiguous:
        names.append("trained on")
    with_paper = any(paper_of(name, row) for row in rows)
    cells = []
    for block in blocks:
        for number, values in enumerate(_values(name, block, with_paper)):
            case = block[number].case
            dataset = case.place if name == "further" else case.test
            # A dataset is named once.
            texts = ["" if number else dataset, case.method, case.trained_on or NONE]
            cells.append([*map(Cell, texts[: len(names)]), *values])
    headers = [h for shown in _SHOWN.values() for h in (shown, "paper")[: 1 + with_paper]]
    breaks, title = _starts(blocks), f"{_TITLES[name]}: {conditions}"
    return Table(title, [*names, *headers], cells, len(names), breaks, notes)


def _values(name: Name, block: Block, with_paper: bool) -> Iterable[tuple[Cell, ...]]:
    """The rows of a block: each metric, the paper's beside it."""
    columns = []
    for metric in _SHOWN:
        texts = [mean_text(row.values(metric).values()) for row in block]
        if metric == "recall_1":
            texts = [f"{t} {row.interval_text()}" for t, row in zip(texts, block, strict=True)]
        columns.append(best_bold(texts, max if same_seeds(block) else None))
        if with_paper:
            rates = [paper_of(name, row) for row in block]
            columns.append([Cell(rate_text(r and getattr(r, metric))) for r in rates])
    return zip(*columns, strict=True)


_Crossing = tuple[Case, dict[int, tuple[float, float]], tuple[SeedGroup, SeedGroup]]
"""A case, by seed its Recall@1 trained on what it is tested on and trained elsewhere, and the rows
of both."""


def _crossings(rows: Sequence[SeedGroup]) -> list[_Crossing]:
    """Recalls on the test region, so that both count the same queries."""
    known = {row.case: row for row in rows}
    crossings = []
    for row in rows:
        home = known.get(replace(row.case, train=row.case.test))
        if row.case.crosses and row.case.region == "test" and home is not None:
            own, away = home.values(), row.values()
            both = {seed: (own[seed], away[seed]) for seed in own if seed in away}
            if both:
                crossings.append((row.case, both, (home, row)))
    return crossings


def _crossing_table(crossings: Sequence[_Crossing], comparison: MethodComparison) -> Table:
    names = ["Dataset", "Approach", "trained elsewhere on"]
    cells: list[list[Cell]] = []
    groups = [list(group) for _, group in groupby(crossings, key=lambda each: each[0].test)]
    for group in groups:
        best = max if len({frozenset(recalls) for _, recalls, _ in group}) == 1 else None
        of_rows = [list(recalls.values()) for _, recalls, _ in group]
        columns = [
            *(best_bold(_recall_texts(group, side), best) for side in (0, 1)),
            best_bold([mean_text([b - a for a, b in both], "+") for both in of_rows], best),
        ]
        for number, ((case, _, _), *values) in enumerate(zip(group, *columns, strict=True)):
            own = ["" if number else case.test, case.method, case.trained_on]
            cells.append([*map(Cell, own), *values])
    means = about_groups(
        (f"{case.method} on {case.test}", list(both)) for case, both, _ in crossings
    )
    return Table(
        f"What crossing costs, Recall@1 on the same test region: {comparison.conditions}",
        [*names, "in-domain", "crossed", "difference"],
        cells,
        len(names),
        _starts(groups),
        [*means, ABOUT_INTERVALS, *comparison.notes],
    )


def _recall_texts(group: Sequence[_Crossing], side: int) -> list[str]:
    """The mean recall of each row with its interval, of the in-domain side 0 or the other one."""
    return [
        f"{mean_text([pair[side] for pair in both.values()])} {rows[side].interval_text(both)}"
        for _, both, rows in group
    ]


def _costs_table(comparison: MethodComparison) -> Table:
    """Medians over all results of a method, and its mean training time."""
    methods: dict[str, list[SeedGroup]] = {}
    for row in comparison.rows:
        methods.setdefault(row.case.method, []).append(row)
    cells = []
    for method in sorted(methods, key=place_of):
        rows = methods[method]
        results = [result for row in rows for result in row.results.values()]
        scan = statistics.median(result.seconds_per_scan for result in results)
        query = statistics.median(result.seconds_per_query for result in results)
        minutes = comparison.minutes.get(method)
        trained = NONE if minutes is None else short_text(minutes)
        texts = [method, short_text(scan * 1e3), short_text(query * 1e3), trained]
        cells.append([*map(Cell, texts), Cell(str(len(seeds_of(rows))))])
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


def _starts(groups: Sequence[Sequence[object]]) -> list[int]:
    """The rows at which all groups but the first begin."""
    return [sum(map(len, groups[:number])) for number in range(1, len(groups))]

"""The paper's ablation tables from the runs of a sweep: Table III (components), Table IV (ways).

A sweep that varies something else gets one table, whose columns are the keys it varies.
"""

import statistics
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from deepring.evaluation.metrics import Over
from deepring.paper.flat import frozen
from deepring.paper.paper_values import (
    AGGREGATIONS,
    INPUTS,
    LOSSES,
    OURS,
    WAYS,
    Components,
    components,
    paper_recall,
    paper_recall_at_ways,
)
from deepring.paper.seed_groups import Row, Rows, Run, collect_rows, varied
from deepring.reports.results_table import recall
from deepring.reports.table import NONE

Name = Literal["table3", "table4", "ablation"]

#: The headers of the first column of Table III and of Table IV.
GROUP, CLASSES = "Ablation", "No. Class"

#: The headers of a row's components.
COMPONENTS = ("Input", "Aggregation", "Loss")
_GROUPS = ("Representation", "Aggregation", "Loss", "Ours")


@dataclass(frozen=True, eq=False)
class Entry:
    """A row as the tables and figures show it."""

    names: Mapping[str, str]
    """Column to text: what the row is."""
    row: Row
    recalls: Mapping[int, float]
    """Seed to Recall@1."""
    paper: float | None
    """The paper's Recall@1, where this is a setting of the paper's."""

    @property
    def mean(self) -> float:
        """Over the seeds."""
        return statistics.fmean(self.recalls.values())

    @property
    def deviation(self) -> float | None:
        """Sample standard deviation over the seeds; None for one."""
        return sample_deviation(self.recalls.values())

    @property
    def text(self) -> str:
        """'0.859 ± 0.010', or '0.859' for one seed."""
        spread = "" if self.deviation is None else f" ± {self.deviation:.3f}"
        return f"{self.mean:.3f}{spread}"


@dataclass(frozen=True, eq=False)
class AblationTable:
    """One table: its entries in the order shown."""

    name: Name
    title: str
    entries: Sequence[Entry]
    notes: Sequence[str]


def ablation_tables(
    runs: Sequence[Run],
    radius: float = 10.0,
    over: Over = "answerable",
    *,
    mix: bool = False,
    notes: Sequence[str] = (),
) -> list[AblationTable]:
    """Table III where components vary, Table IV where the ways of SG/DFT/CE vary, or one of keys.

    Args:
        runs: finished runs, each with a result of the trained network.
        radius: metres; the results at this radius are shown.
        over: Recall@1 as the share of the answerable queries, or of all.
        mix: let runs on different data or under different protocols stand beside each other.
        notes: further notes to stand below every table.

    Raises:
        DeepringError: as `collect_rows`, and an unknown ``over``.
    """
    found = collect_rows(runs, radius, mix=mix)
    classes, others = _split(found.rows)
    tables: list[tuple[Name, str, list[Entry]]] = []
    if classes:
        tables.append(
            ("table4", "Class number (the paper's Table IV), ", _class_entries(classes, over))
        )
    if len({components(row) for row in others}) > 1:
        entries = _component_entries(others, found.mixed, over)
        tables.insert(0, ("table3", "Components (the paper's Table III), ", entries))
    elif others:
        tables.append(("ablation", "", _key_entries(others, over)))
    where = _where(found, radius, over)
    return [
        AblationTable(name, f"{title}{where}", entries, [*_seeds(entries), *found.notes, *notes])
        for name, title, entries in tables
    ]


def _split(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """The rows of Table IV, none where it is none, and those of the other table.

    Rows of SG/DFT/CE that differ in ways alone are Table IV. Those with the ways of other
    components stand in Table III too.
    """
    ours = [row for row in rows if components(row) == OURS]
    ways: dict[str, set[int]] = {}
    for row in ours:
        rest = {key: value for key, value in row.setting.items() if key != WAYS}
        ways.setdefault(frozen(rest), set()).add(row.setting.get(WAYS, 0))
    if not any(len(several) > 1 for several in ways.values()):
        return [], list(rows)
    elsewhere = {row.setting.get(WAYS) for row in rows if components(row) != OURS}
    return ours, [row for row in rows if row.setting.get(WAYS) in elsewhere]


def _component_entries(rows: Sequence[Row], mixed: Collection[str], over: Over) -> list[Entry]:
    kinds: dict[Components, list[Row]] = {}
    for row in rows:
        kinds.setdefault(components(row), []).append(row)
    # A key that follows from the components tells nothing that these do not.
    within = {key for alike in kinds.values() for key in varied(alike)}
    keys = sorted(within | set(mixed) & set(varied(rows)))

    def place(row: Row) -> Any:
        own = components(row)
        known = zip(own, (INPUTS, AGGREGATIONS, LOSSES), strict=True)
        order = [_position(part, list(names.values())) for part, names in known]
        return _GROUPS.index(_group(own)), order, [by_size(row.setting.get(key)) for key in keys]

    return [
        _entry(
            {GROUP: _group(components(row))}
            | dict(zip(COMPONENTS, components(row), strict=True))
            | {key: value_text(row.setting.get(key)) for key in keys},
            row,
            over,
            paper_recall(row, rows),
        )
        for row in sorted(rows, key=place)
    ]


def _class_entries(rows: Sequence[Row], over: Over) -> list[Entry]:
    keys = [key for key in varied(rows) if key != WAYS]

    def place(row: Row) -> Any:
        return [by_size(row.setting.get(key)) for key in (*keys, WAYS)]

    return [
        _entry(
            {CLASSES: value_text(row.setting.get(WAYS))}
            | {key: value_text(row.setting.get(key)) for key in keys},
            row,
            over,
            paper_recall_at_ways(row, rows),
        )
        for row in sorted(rows, key=place)
    ]


def _key_entries(rows: Sequence[Row], over: Over) -> list[Entry]:
    keys = varied(rows)

    def names(row: Row) -> dict[str, str]:
        if not keys:
            return dict(zip(COMPONENTS, components(row), strict=True))
        return {key: value_text(row.setting.get(key)) for key in keys}

    ordered = sorted(rows, key=lambda row: [by_size(row.setting.get(key)) for key in keys])
    return [_entry(names(row), row, over, paper_recall(row, rows)) for row in ordered]


def _entry(names: Mapping[str, str], row: Row, over: Over, paper: float | None) -> Entry:
    recalls = {seed: recall(result, 1, over) for seed, result in row.results.items()}
    return Entry(names, row, recalls, paper)


def _group(own: Components) -> str:
    """The paper's group: the first component that is not ours, its loss before its aggregation."""
    if own.input != OURS.input:
        return "Representation"
    if own.loss != OURS.loss:
        return "Loss"
    return "Ours" if own == OURS else "Aggregation"


def _where(found: Rows, radius: float, over: Over) -> str:
    places = sorted({r.case.place for row in found.rows for r in row.results.values()})
    return f"{', '.join(places)}: right within {radius:g} m, recall over {over} queries"


def _seeds(entries: Sequence[Entry]) -> list[str]:
    """What the values are means of, and which rows lack seeds that others have."""
    every = sorted({seed for entry in entries for seed in entry.recalls})
    lacking = [entry for entry in entries if sorted(entry.recalls) != every]
    if len(every) == 1:
        return [f"one run a row, seed {every[0]}"]
    note = f"mean ± sample standard deviation over the seeds {_listed(every)}"
    if not lacking:
        return [note]
    rows = "; ".join(f"{_label(entry)} has {_listed(entry.recalls)}" for entry in lacking)
    return [note, f"rows are not over the same seeds, so that none is marked best: {rows}"]


def _listed(seeds: Iterable[int]) -> str:
    return ", ".join(map(str, seeds))


def _label(entry: Entry) -> str:
    names = (
        text if name in COMPONENTS else f"{name} {text}"
        for name, text in entry.names.items()
        if name != GROUP
    )
    return " ".join(names)


def _position(name: str, known: Sequence[str]) -> tuple[int, str]:
    return (known.index(name) if name in known else len(known)), name


def by_size(value: Any) -> tuple[int, float, str]:
    """Absent values first, then numbers by size, then the rest as text."""
    if value is None:
        return 0, 0.0, ""
    return (1, value, "") if isinstance(value, int | float) else (2, 0.0, str(value))


def value_text(value: Any) -> str:
    """A config value as a cell; "-" for none."""
    if value is None:
        return NONE
    return f"{value:g}" if isinstance(value, float) else str(value)


def sample_deviation(values: Collection[float]) -> float | None:
    """Standard deviation with n - 1; None for one value."""
    return statistics.stdev(values) if len(values) > 1 else None

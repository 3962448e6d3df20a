"""The paper's ablation tables from the runs of a sweep: Table III (components), Table IV (ways).

A sweep that varies something else gets one table, whose columns are the keys it varies.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from deepring.evaluation.metrics import Over
from deepring.paper.ablation_results import PROTOCOL, collect_rows
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
from deepring.paper.seed_groups import ABOUT_INTERVALS, Run, SeedGroup, seeds_of, varied, within
from deepring.paper.seed_words import about_lacking, about_means, sample_deviation
from deepring.reports.table import NONE

Name = Literal["table3", "table4", "ablation"]

#: The headers of the first column of Table III and of Table IV.
GROUP, CLASSES = "Ablation", "No. Class"

#: The cell of a row that has a part of the config which others lack.
WITH = "with"

#: The headers of a row's components.
COMPONENTS = ("Input", "Aggregation", "Loss")
_GROUPS = ("Representation", "Aggregation", "Loss", "Ours")


@dataclass(frozen=True, eq=False)
class Entry:
    """A row as the tables and figures show it."""

    names: Mapping[str, str]
    """Column to text: what the row is."""
    row: SeedGroup
    paper: float | None
    """The paper's Recall@1, where this is a setting of the paper's."""

    @property
    def recalls(self) -> dict[int, float]:
        """Seed to Recall@1."""
        return self.row.values()

    @property
    def mean(self) -> float:
        """Over the seeds."""
        return statistics.fmean(self.recalls.values())

    @property
    def deviation(self) -> float | None:
        """Sample standard deviation over the seeds; None for one."""
        return sample_deviation(self.recalls.values())


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
    rows, shared = collect_rows(runs, radius, over, mix=mix)
    classes, others = _split(rows)
    tables: list[tuple[Name, str, list[Entry]]] = []
    if classes:
        title = "Class number (the paper's Table IV), "
        tables.append(("table4", title, _class_entries(classes)))
    if len({components(row) for row in others}) > 1:
        title = "Components (the paper's Table III), "
        tables.insert(0, ("table3", title, _component_entries(others)))
    elif others:
        tables.append(("ablation", "", _key_entries(others)))
    places = sorted({r.case.place for row in rows for r in row.results.values()})
    where = f"{', '.join(places)}: {within(rows)}, recall over {over} queries"
    return [
        AblationTable(
            name, f"{title}{where}", entries, [*_seeds(entries), ABOUT_INTERVALS, *shared, *notes]
        )
        for name, title, entries in tables
    ]


def _split(rows: Sequence[SeedGroup]) -> tuple[list[SeedGroup], list[SeedGroup]]:
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


def _component_entries(rows: Sequence[SeedGroup]) -> list[Entry]:
    kinds: dict[Components, list[SeedGroup]] = {}
    for row in rows:
        kinds.setdefault(components(row), []).append(row)
    # A key that follows from the components tells nothing that these do not.
    within = {key for alike in kinds.values() for key in varied(alike)}
    keys = [key for key in varied(rows) if key in within or PROTOCOL.fullmatch(key)]

    def place(row: SeedGroup) -> Any:
        own = components(row)
        known = zip(own, (INPUTS, AGGREGATIONS, LOSSES), strict=True)
        order = [_position(part, list(names.values())) for part, names in known]
        return _GROUPS.index(_group(own)), order, _sizes(row, keys)

    return [
        Entry(
            {GROUP: _group(components(row))} | _component_names(row) | _texts(row, keys, rows),
            row,
            paper_recall(row, rows),
        )
        for row in sorted(rows, key=place)
    ]


def _class_entries(rows: Sequence[SeedGroup]) -> list[Entry]:
    keys = [key for key in varied(rows) if key != WAYS]
    return [
        Entry(
            {CLASSES: value_text(row.setting.get(WAYS))} | _texts(row, keys, rows),
            row,
            paper_recall_at_ways(row, rows),
        )
        for row in sorted(rows, key=lambda row: _sizes(row, [*keys, WAYS]))
    ]


def _key_entries(rows: Sequence[SeedGroup]) -> list[Entry]:
    keys = varied(rows)
    return [
        Entry(_texts(row, keys, rows) or _component_names(row), row, paper_recall(row, rows))
        for row in sorted(rows, key=lambda row: _sizes(row, keys))
    ]


def _component_names(row: SeedGroup) -> dict[str, str]:
    return dict(zip(COMPONENTS, components(row), strict=True))


def _texts(row: SeedGroup, keys: Sequence[str], rows: Sequence[SeedGroup]) -> dict[str, str]:
    """What a row is, by column: a key, or a whole part of the config that rows have or lack."""
    whole = {part for part in map(_part, keys) if _whole(_within(part, keys), rows)}
    texts = {}
    for key in keys:
        if (part := _part(key)) in whole:
            texts[part] = NONE if row.setting.get(key) is None else WITH
        else:
            texts[key] = value_text(row.setting.get(key))
    return texts


def _part(key: str) -> str:
    return key.rpartition(".")[0]


def _within(part: str, keys: Sequence[str]) -> list[str]:
    return [key for key in keys if _part(key) == part]


def _whole(keys: Sequence[str], rows: Sequence[SeedGroup]) -> bool:
    """Whether rows have all of several keys with the same values, or none of them."""
    values = [[row.setting.get(key) for key in keys] for row in rows]
    given = [of_row for of_row in values if any(value is not None for value in of_row)]
    return len(keys) > 1 and all(None not in v and frozen(v) == frozen(given[0]) for v in given)


def _sizes(row: SeedGroup, keys: Sequence[str]) -> list[tuple[int, float, str]]:
    return [by_size(row.setting.get(key)) for key in keys]


def _group(own: Components) -> str:
    """The paper's group: the first component that is not ours, its loss before its aggregation."""
    if own.input != OURS.input:
        return "Representation"
    if own.loss != OURS.loss:
        return "Loss"
    return "Ours" if own == OURS else "Aggregation"


def _seeds(entries: Sequence[Entry]) -> list[str]:
    """Notes on the seeds behind the means, and on rows that lack some of them."""
    labels = {entry.row: _label(entry) for entry in entries}
    return [about_means(seeds_of(labels)), *about_lacking(list(labels), labels.__getitem__)]


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

"""Ablation tables as texts: as the paper prints them, and in full for the CSV file."""

import statistics
from collections.abc import Iterable, Sequence

from deepring.paper.ablation import CLASSES, GROUP, AblationTable, Entry, by_size
from deepring.paper.paper_values import WAYS
from deepring.paper.seed_groups import same_seeds, seeds_of, varied
from deepring.paper.seed_words import mean_text, sample_deviation
from deepring.reports.table import NONE, Cell, Table, best_bold, full_text, rate_text

_METRICS = ("recall_1", "f1_max", "auc", "ap")


def shown_table(table: AblationTable) -> Table:
    """The table as the paper prints it, means to three digits, the best in bold."""
    return _ways_table(table) if table.name == "table4" else _rows_table(table)


def number_table(table: AblationTable) -> Table:
    """Every key that varies and every number in full, one row an entry; "" where there is none.

    Beside the names and keys: n and the seeds; mean and sample standard deviation of Recall@1,
    maximal F1, AUC and AP; the paper's Recall@1; Recall@1 of each seed with its 95 % interval.
    """
    rows = [entry.row for entry in table.entries]
    keys = varied(rows)
    names = [name for name in table.entries[0].names if name not in keys]
    seeds = seeds_of(rows)
    spread = [f"{what}_{of}" for what in _METRICS for of in ("mean", "std")]
    by_seed = [f"seed_{seed}{end}" for seed in seeds for end in ("", "_low", "_high")]
    headers = [*names, *keys, "n", "seeds", *spread, "paper", *by_seed]
    cells = []
    for entry in table.entries:
        texts = [entry.names[name] for name in names]
        texts += [str(entry.row.setting.get(key, "")) for key in keys]
        texts += [str(len(entry.recalls)), " ".join(map(str, entry.recalls))]
        for metric in _METRICS:
            values = entry.row.values(metric).values()
            texts += [full_text(statistics.fmean(values)), full_text(sample_deviation(values))]
        texts.append(full_text(entry.paper))
        texts += [full_text(number) for seed in seeds for number in entry.row.with_interval(seed)]
        cells.append([*map(Cell, texts)])
    return Table(table.title, headers, cells, len(names) + len(keys))


def _rows_table(table: AblationTable) -> Table:
    names = list(table.entries[0].names)
    grouped = names[0] == GROUP
    with_paper = grouped or any(entry.paper is not None for entry in table.entries)
    values = _best_bold(table.entries)
    groups = [entry.names[GROUP] if grouped else "" for entry in table.entries]
    breaks = [k for k in range(1, len(groups)) if groups[k] != groups[k - 1]]
    rows = []
    for k, (entry, value) in enumerate(zip(table.entries, values, strict=True)):
        texts = list(entry.names.values())
        if grouped and k and k not in breaks:
            texts[0] = ""  # a group is named once
        paper = [Cell(rate_text(entry.paper))] if with_paper else []
        rows.append([*map(Cell, texts), value, *paper])
    headers = [*names, "Recall@1", *(["paper"] if with_paper else [])]
    return Table(table.title, headers, rows, len(names), breaks, table.notes)


def _ways_table(table: AblationTable) -> Table:
    """Ways as columns; a line for each setting of the other keys, and the paper's below."""
    ways = list(dict.fromkeys(entry.names[CLASSES] for entry in _by_ways(table.entries)))
    keys = [name for name in table.entries[0].names if name != CLASSES]
    lines: dict[tuple[str, ...], dict[str, Cell]] = {}
    paper: dict[str, Cell] = {}
    cells = _best_bold(table.entries)
    for entry, cell in zip(table.entries, cells, strict=True):
        lines.setdefault(tuple(entry.names[key] for key in keys), {})[entry.names[CLASSES]] = cell
        if entry.paper is not None:
            paper[entry.names[CLASSES]] = Cell(rate_text(entry.paper))
    rows = [
        [
            Cell("Recall@1"),
            *map(Cell, names),
            *(line.get(way, Cell(NONE)) for way in ways),
        ]
        for names, line in lines.items()
    ]
    if paper:
        blank = [Cell("")] * len(keys)
        rows.append([Cell("paper"), *blank, *(paper.get(way, Cell(NONE)) for way in ways)])
    headers = [CLASSES, *keys, *ways]
    return Table(table.title, headers, rows, 1 + len(keys), [len(lines)], table.notes)


def _best_bold(entries: Sequence[Entry]) -> list[Cell]:
    """The best mean in bold; none where means are not over the same seeds, and so the same data."""
    texts = [f"{mean_text(e.recalls.values())} {e.row.interval_text()}" for e in entries]
    return best_bold(texts, max if same_seeds(entry.row for entry in entries) else None)


def _by_ways(entries: Iterable[Entry]) -> list[Entry]:
    return sorted(entries, key=lambda entry: by_size(entry.row.setting.get(WAYS)))

"""The page of a sweep or a comparison: the best, tables, curves, pairs, and links to its runs."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

from deepring.evaluation.metrics import Over
from deepring.experiment.runs import find_runs
from deepring.experiment.sweep_rows import SweepRows
from deepring.paper.ablation import (
    CLASSES,
    COMPONENTS,
    GROUP,
    WITH,
    AblationTable,
    Entry,
    ablation_tables,
)
from deepring.paper.ablation_results import by_place
from deepring.paper.ablation_tables import shown_table
from deepring.paper.comparison import Block, MethodComparison, Name, compare, is_comparison
from deepring.paper.comparison_tables import shown_tables
from deepring.paper.seed_groups import Run
from deepring.reports import html
from deepring.reports.comparison_sections import curves, leaders, pairs, side_by_side
from deepring.reports.escaping import escaped
from deepring.reports.method_results import Kinds, RegionResults
from deepring.reports.results_table import within_text
from deepring.reports.table import NONE, Table

_KINDS: dict[Name, str] = {
    "table1": "in-domain",
    "table2": "cross-domain",
    "further": "nothing trained on it",
}


def sweep_page(
    folders: Sequence[Path], radius: float, over: Over, beside: Path, *, mix: bool = False
) -> str:
    """The page of all finished runs in folders.

    Args:
        folders: of a sweep or a comparison, which has the name of the first.
        radius: metres; the results at this radius are shown.
        over: recall as the share of the answerable queries, or of all.
        beside: the folder of the page, from which it leads to the pages of the runs.
        mix: let runs on different data or under different protocols stand beside each other.

    Raises:
        DeepringError: as `find_runs`, `compare` and `ablation_tables`.
    """
    collection = find_runs(folders)
    runs = collection.runs
    compares = is_comparison(runs)
    shown = _comparison if compares else _ablation
    tables, regions = shown(runs, radius, over, mix=mix, notes=collection.notes)
    kinds = Kinds(regions)
    what = "method" if compares else "setting"
    first = regions[0]
    within = within_text(first.radius, first.wrong_beyond or first.radius)
    parts = [
        *leaders(regions, what),
        html.heading(f"{what.capitalize()}s side by side, {within}"),
        *side_by_side(regions, kinds, what.capitalize()),
        html.heading("Curves"),
        *curves(regions, kinds),
        html.heading("Which differences are more than chance"),
        *pairs(regions),
        html.heading("Tables"),
        *map(html.shown_table, tables),
        html.heading("Runs"),
        _runs_table(runs, folders[0], beside),
    ]
    if collection.notes:
        parts.append(html.bullets(collection.notes, 50))
    title = "Comparison" if compares else "Sweep"
    return html.page(f"{title}: {folders[0].resolve().name}", parts)


def _comparison(
    runs: Sequence[Run], radius: float, over: Over, *, mix: bool, notes: Sequence[str]
) -> tuple[list[Table], list[RegionResults]]:
    """Tables I and II and what else there is, and each test with its methods."""
    comparison = compare(runs, radius, over, mix=mix, notes=notes)
    regions = list(_regions(comparison, SweepRows(runs)))
    return list(shown_tables(comparison).values()), regions


def _regions(comparison: MethodComparison, rows: SweepRows) -> Iterator[RegionResults]:
    seen = set()
    for name, blocks in comparison.blocks.items():
        for block in blocks:
            place = block[0].case.place
            if place not in seen:
                seen.add(place)
                yield _region(f"{place}, {_KINDS[name]}", block, rows)


def _region(title: str, block: Block, rows: SweepRows) -> RegionResults:
    """The methods of a test; what they were trained on is said where that differs."""
    names = [row.case.method for row in block]
    methods = [
        rows.method(
            row, row.case.method, row.case.trained_on if names.count(row.case.method) > 1 else ""
        )
        for row in block
    ]
    return rows.region(title, methods, block[0])


def _ablation(
    runs: Sequence[Run], radius: float, over: Over, *, mix: bool, notes: Sequence[str]
) -> tuple[list[Table], list[RegionResults]]:
    """The tables of each place that all runs were tested in, and their settings."""
    places = by_place(runs)
    # Runs that were tested elsewhere than others are for `ablation_tables` to refuse.
    apart = len(places) > 1 and all(len(there) == len(runs) for there in places.values())
    tables, regions = [], []
    for there in places.values() if apart else [runs]:
        rows = SweepRows(there)
        for table in ablation_tables(there, radius, over, mix=mix, notes=notes):
            tables.append(shown_table(table))
            regions.append(_settings(table, rows))
    return tables, regions


def _settings(table: AblationTable, rows: SweepRows) -> RegionResults:
    varied = [
        name
        for name in table.entries[0].names
        if name != GROUP and len({entry.names[name] for entry in table.entries}) > 1
    ]
    methods = [rows.method(entry.row, setting_name(entry, varied)) for entry in table.entries]
    row = table.entries[0].row
    place = next(iter(row.results.values())).case.place
    kind = {"table3": "components", "table4": "class number", "ablation": "settings"}[table.name]
    return rows.region(f"{place}, {kind}", methods, row)


def setting_name(entry: Entry, varied: Sequence[str]) -> str:
    """What a setting is, of the columns that vary: 'SG/DFT/CE, with augmentation, ways 8'."""
    components = [entry.names[name] for name in COMPONENTS if name in varied]
    parts = ["/".join(components)] if components else []
    for name in varied:
        text = entry.names[name]
        if name in COMPONENTS:
            continue
        if text in (WITH, NONE):
            parts.append(f"{'with' if text == WITH else 'without'} {name}")
        else:
            parts.append(f"{'ways' if name == CLASSES else name} {text}")
    return ", ".join(parts) or "the only one"


def _runs_table(runs: Sequence[Run], folder: Path, beside: Path) -> str:
    """Every run with its seed and training time; a run's own page is linked where there is one."""

    def row(run: Run) -> list[str]:
        path = Path(run.folder)
        name = os.path.relpath(path, folder)
        minutes = "-" if run.seconds is None else f"{run.seconds / 60:.1f}"
        methods = ", ".join(dict.fromkeys(r.case.method for r in run.results))
        page = path / "report.html"
        to = quote(os.path.relpath(page, beside)) if page.is_file() else None
        return [html.link(name, to), *map(escaped, (str(run.seed), minutes, methods))]

    head = ("run", "seed", "training (min)", "methods")
    return html.table_of_html(head, map(row, runs), ("methods",))

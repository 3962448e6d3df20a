"""`deepring tables`: the ablation tables of a sweep, or those that compare methods."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from deepring.checks import one_of
from deepring.cli.console import console
from deepring.cli.options import expect_folder
from deepring.cli.written_tables import write_shown, write_text
from deepring.evaluation.case import in_file_names
from deepring.evaluation.matches import FOLDER, matches_in
from deepring.evaluation.metrics import Over
from deepring.experiment.runs import find_runs
from deepring.paper.ablation import AblationTable, ablation_tables
from deepring.paper.ablation_figures import ablation_figure
from deepring.paper.ablation_results import by_place
from deepring.paper.ablation_tables import number_table, shown_table
from deepring.paper.comparison import MethodComparison, compare, is_comparison
from deepring.paper.comparison_figures import comparison_figure, curve_panels
from deepring.paper.comparison_tables import number_table as comparison_numbers
from deepring.paper.comparison_tables import shown_tables
from deepring.paper.paired_tables import number_table as paired_numbers
from deepring.paper.paired_tables import pairs_of, retrieved_by_case, shown_pairs
from deepring.paper.seed_groups import Run
from deepring.reports.style import save
from deepring.reports.table import csv, terminal


def tables_command(args: argparse.Namespace) -> None:
    """Print the tables of finished runs, and write them."""
    over = one_of("over", args.over, Over)
    folder = args.output or args.paths[0] / "tables"
    expect_folder(folder)
    collection = find_runs(args.paths)
    runs = collection.runs
    options = {"mix": args.mix, "notes": collection.notes}
    if is_comparison(runs):
        _show_comparison(compare(runs, args.radius, over, **options), runs, folder)
    else:
        places = by_place(runs)
        # Runs that were tested elsewhere than others are for `ablation_tables` to refuse.
        if len(places) < 2 or any(len(there) < len(runs) for there in places.values()):
            _show_ablation(ablation_tables(runs, args.radius, over, **options), folder)
            return
        for place, there in places.items():
            tables = ablation_tables(there, args.radius, over, **options)
            _show_ablation(tables, folder / in_file_names(place))


def _show_ablation(tables: Sequence[AblationTable], folder: Path) -> None:
    """Print the tables, and write each in every format and as a figure."""
    texts = [shown_table(table) for table in tables]
    console.print(terminal(texts))
    for table, text in zip(tables, texts, strict=True):
        write_shown(table.name, text, folder)
        write_text(folder / f"{table.name}.csv", csv(number_table(table)))
        _save(ablation_figure(table), folder / f"{table.name}.png")


def _show_comparison(comparison: MethodComparison, runs: Sequence[Run], folder: Path) -> None:
    """Print the tables, and write them, all numbers in one file, and a figure."""
    tables = shown_tables(comparison)
    console.print(terminal(list(tables.values())))
    for name, table in tables.items():
        write_shown(name, table, folder)
    write_text(folder / "comparison.csv", csv(comparison_numbers(comparison)))
    retrieved = retrieved_by_case(
        (run.seed, of_case) for run in runs for of_case in matches_in(run.folder)
    )
    pairs = pairs_of(comparison, retrieved)
    if shown := shown_pairs(pairs, comparison):
        console.print(terminal([shown]))
        write_shown("paired", shown, folder)
        write_text(folder / "paired.csv", csv(paired_numbers(pairs)))
    matches = ((seed, of_case) for (_, seed), of_case in retrieved.items())
    panels, lacking = curve_panels(comparison, matches)
    if panels:
        for row in lacking:
            console.print(f"no curve     {row}: no {FOLDER}/*.csv")
        _save(comparison_figure(panels, comparison.radius), folder / "pr_curves.png")
    else:
        console.print(f"no figure    no {FOLDER}/*.csv of Table I or II in the run folders")


def _save(figure: Figure, path: Path) -> None:
    save(figure, path)
    console.print(f"figure       {path}")

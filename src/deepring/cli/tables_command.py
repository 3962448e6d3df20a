"""`deepring tables`: the ablation tables of a sweep, or those that compare methods."""

import argparse
from collections.abc import Sequence
from typing import Any

from deepring.checks import one_of
from deepring.cli.json_output import print_json
from deepring.cli.options import expect_folder
from deepring.cli.shown_tables import ShownTables
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


def tables_command(args: argparse.Namespace) -> None:
    """Print the tables of finished runs, and write them."""
    content = make_tables(args)
    if content is not None:
        print_json("tables", content)


def make_tables(args: argparse.Namespace) -> dict[str, Any] | None:
    """Write the tables, and print them; with ``--as json`` return what ``tables`` holds."""
    over = one_of("over", args.over, Over)
    folder = args.output or args.paths[0] / "tables"
    expect_folder(folder)
    collection = find_runs(args.paths)
    runs = collection.runs
    output = ShownTables(folder, quiet=args.form == "json")
    options = {"mix": args.mix, "notes": collection.notes}
    if is_comparison(runs):
        _show_comparison(compare(runs, args.radius, over, **options), runs, output)
    else:
        places = by_place(runs)
        # Runs that were tested elsewhere than others are for `ablation_tables` to refuse.
        if len(places) < 2 or any(len(there) < len(runs) for there in places.values()):
            _show_ablation(ablation_tables(runs, args.radius, over, **options), output)
        else:
            for place, there in places.items():
                tables = ablation_tables(there, args.radius, over, **options)
                _show_ablation(tables, output, f"{in_file_names(place)}/")
    if args.form != "json":
        return None
    return {"radius_m": args.radius, "over": over, **output.content()}


def _show_ablation(tables: Sequence[AblationTable], output: ShownTables, below: str = "") -> None:
    """Print the tables, and write each in every format and as a figure."""
    output.print({f"{below}{table.name}": shown_table(table) for table in tables})
    for table in tables:
        name = f"{below}{table.name}"
        output.write_shown(name)
        output.write_numbers(name, number_table(table))
        output.write_figure(name, ablation_figure(table))


def _show_comparison(
    comparison: MethodComparison, runs: Sequence[Run], output: ShownTables
) -> None:
    """Print the tables, and write them, all numbers in one file, and a figure."""
    tables = shown_tables(comparison)
    output.print(tables)
    for name in tables:
        output.write_shown(name)
    output.write_numbers("comparison", comparison_numbers(comparison))
    retrieved = retrieved_by_case(
        (run.seed, of_case) for run in runs for of_case in matches_in(run.folder)
    )
    pairs = pairs_of(comparison, retrieved)
    if shown := shown_pairs(pairs, comparison):
        output.print({"paired": shown})
        output.write_shown("paired")
        output.write_numbers("paired", paired_numbers(pairs))
    matches = ((seed, of_case) for (_, seed), of_case in retrieved.items())
    panels, lacking = curve_panels(comparison, matches)
    if panels:
        for row in lacking:
            output.say(f"no curve     {row}: no {FOLDER}/*.csv")
        output.write_figure("pr_curves", comparison_figure(panels, comparison.radius))
    else:
        output.say(f"no figure    no {FOLDER}/*.csv of Table I or II in the run folders")

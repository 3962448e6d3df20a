"""`deepring tables`: the ablation tables of a sweep."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from deepring.cli.report import console
from deepring.evaluation.ablation import AblationTable, ablation_tables
from deepring.evaluation.ablation_grids import number_grid, shown_grid
from deepring.evaluation.grid import csv, latex, markdown, terminal
from deepring.evaluation.metrics import Over
from deepring.experiment.runs import find_runs
from deepring.files import replacing
from deepring.viz.ablation import ablation_figure
from deepring.viz.style import save


def tables_command(arguments: Sequence[str]) -> None:
    """``deepring tables PATH [PATH ...]``: print the tables of finished runs, and write them."""
    args = _parser().parse_args(arguments)
    found = find_runs(args.paths)
    tables = ablation_tables(found.runs, args.radius, args.over, mix=args.mix, notes=found.left_out)
    folder = args.output or args.paths[0] / "tables"
    console.print(terminal([shown_grid(table) for table in tables]))
    for table in tables:
        _write(table, folder)


def _write(table: AblationTable, folder: Path) -> None:
    """Write a table in every format, and its figure, and say where they lie."""
    grid = shown_grid(table)
    texts = {"md": markdown([grid]), "tex": latex(grid), "csv": csv(number_grid(table))}
    for ending, text in texts.items():
        path = folder / f"{table.name}.{ending}"
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", newline="")
        console.print(f"{_WHAT[ending]:<12} {path}", markup=False)
    save(ablation_figure(table), folder / f"{table.name}.png")
    console.print(f"figure       {folder / f'{table.name}.png'}", markup=False)


_WHAT = {"md": "table", "tex": "latex", "csv": "numbers"}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "deepring tables",
        description="Print the ablation tables of finished runs, beside the paper's values, and "
        "write them as Markdown, LaTeX, CSV and a figure. Runs that differ in nothing but the "
        "seed are one row.",
    )
    parser.add_argument(
        "paths", type=Path, nargs="+", metavar="PATH", help="folder of a sweep, or of a run"
    )
    parser.add_argument("--radius", type=float, default=10.0, help="metres (default: 10)")
    parser.add_argument(
        "--over",
        choices=get_args(Over),
        default="answerable",
        help="queries that recall is a share of (default: answerable)",
    )
    parser.add_argument(
        "--mix",
        action="store_true",
        help="let runs on different data or under different protocols stand beside each other",
    )
    parser.add_argument(
        "-o",
        dest="output",
        type=Path,
        metavar="FOLDER",
        help="where to write (default: tables in the first PATH)",
    )
    return parser

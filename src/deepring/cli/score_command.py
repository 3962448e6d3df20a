"""`deepring score`: the figures of exported descriptors, at any radii, without scans."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from deepring.cli.console import console
from deepring.errors import DeepringError
from deepring.evaluation.metrics import Over
from deepring.evaluation.protocol import RADII
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.scoring import find_pairs, score_pair
from deepring.progress import progress_bar
from deepring.reports.results_table import render, render_radii


def score_command(arguments: Sequence[str]) -> None:
    """``deepring score FOLDER [--radii 10,5,25] [--over answerable|all] [-o results.csv]``."""
    args = _parser().parse_args(arguments)
    radii = _radii(args.radii)
    if args.output is not None and args.output.exists():
        raise DeepringError(
            f"-o {args.output}: exists, expected a new file; nothing is overwritten: name another"
        )
    results: list[Result] = []
    for pair in find_pairs(args.folder):
        with progress_bar(f"{pair.query.name}: looking up") as bar:
            results += score_pair(pair, radii, bar).results
    console.print(render(results, radii[0], args.over))
    if len(radii) > 1:
        console.print(render_radii(results, args.over))
    if args.output is not None:
        write_results(args.output, results)
        console.print(f"results      {args.output}", markup=False)


def _radii(text: str) -> list[float]:
    """Metres, split at commas. Raises DeepringError unless they are lengths and all differ."""
    try:
        radii = [float(part) for part in text.split(",")]
    except ValueError:
        radii = []
    if not radii or len(set(radii)) < len(radii) or not all(0 < r < math.inf for r in radii):
        raise DeepringError(
            f"--radii {text!r}: expected different lengths in metres, such as 10,5,25"
        )
    return radii


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "deepring score",
        description="Look exported descriptors up again and print what that gives. Neither the "
        "scans nor the weights are needed.",
    )
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="a run's folder, or that of its descriptors"
    )
    shown = ",".join(f"{radius:g}" for radius in RADII)
    parser.add_argument(
        "--radii",
        default=shown,
        metavar="M,M,...",
        help=f"revisit radii in metres, the headline first (default: {shown})",
    )
    parser.add_argument(
        "--over",
        choices=get_args(Over),
        default="answerable",
        help="queries that recall is a share of (default: answerable)",
    )
    parser.add_argument(
        "-o", dest="output", type=Path, metavar="FILE", help="also write the results as CSV"
    )
    return parser

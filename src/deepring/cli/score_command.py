"""`deepring score`: the rates of exported descriptors, at any radii, without scans."""

import argparse

from deepring.checks import one_of
from deepring.cli.console import console
from deepring.cli.json_output import print_as
from deepring.cli.options import expect_new
from deepring.cli.results_content import results_content
from deepring.evaluation.metrics import Over
from deepring.evaluation.results import Result, write_results
from deepring.evaluation.scoring import find_pairs, score_pair
from deepring.progress import progress_bar
from deepring.reports.results_table import render, render_radii


def score_command(args: argparse.Namespace) -> None:
    """Print the rates, and write them with --output."""
    over = one_of("over", args.over, Over)
    if args.output is not None:
        expect_new(args.output)
    results: list[Result] = []
    for pair in find_pairs(args.folder):
        with progress_bar(f"{pair.query.name}: looking up") as bar:
            outcome = score_pair(pair, args.radii, bar, args.method, wrong_beyond=args.wrong_beyond)
            results += outcome.results
    written = [] if args.output is None else [args.output]
    for path in written:
        write_results(path, results)

    def text() -> None:
        console.print(render(results, args.radii[0], over))
        if len(args.radii) > 1:
            console.print(render_radii(results, over))
        for path in written:
            console.print(f"results      {path}")

    content = results_content(results, args.radii[0], over)
    print_as(args, "results", lambda: {"run": args.folder, **content, "written": written}, text)

"""`deepring report`: a run as one HTML page."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from deepring.cli.console import console
from deepring.errors import DeepringError
from deepring.experiment.report import report
from deepring.io.files import write_whole


def report_command(arguments: Sequence[str]) -> None:
    """``deepring report RUN [-o FILE.html] [--failures 6]``."""
    parser = argparse.ArgumentParser(
        "deepring report",
        description="Write a run as one page: results, maps of hits and misses, curves, and the "
        "worst failures with their scans. It needs no network and no server.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of an evaluated run")
    parser.add_argument("-o", dest="output", type=Path, metavar="FILE", help="RUN/report.html")
    parser.add_argument("--failures", type=int, default=6, help="how many are drawn (6)")
    args = parser.parse_args(arguments)
    output = args.output or args.run / "report.html"
    if args.output is not None and output.exists():
        raise DeepringError(
            f"-o {output}: exists, expected a new file; nothing is overwritten: name another"
        )
    if args.failures < 0:
        raise DeepringError(f"--failures {args.failures}: expected at least 0")
    text = report(args.run, args.failures)
    write_whole(output, [text.encode()])
    console.print(f"written      {output}", markup=False)

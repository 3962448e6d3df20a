"""`deepring report`: a run as one HTML page."""

import argparse

from deepring.cli.console import console
from deepring.cli.json_output import show_written
from deepring.cli.options import expect_new, expect_writable
from deepring.experiment.report import report
from deepring.io.files import write_whole


def report_command(args: argparse.Namespace) -> None:
    """Write the page, by default to RUN/report.html, which is replaced."""
    if args.output is not None:
        expect_new(args.output)
    path = args.output or args.run / "report.html"
    expect_writable(path)
    write_whole(path, [report(args.run, args.pictures).encode("utf-8", "backslashreplace")])
    show_written(args, [path], lambda: console.print(f"written      {path}"))

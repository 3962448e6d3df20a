"""`deepring data check`: whether a download can be used."""

import argparse
import sys

from deepring.data.check import check
from deepring.data.check_table import report_lines
from deepring.progress import progress_bar


def data_command(args: argparse.Namespace) -> None:
    """Print what each session holds; exit with 1 if a session or a scan cannot be used."""
    with progress_bar("reading scans") as bar:
        reports = check(args.root, args.format, args.session, bar)
    print("\n".join(report_lines(reports)))
    if not all(report.usable and not report.broken for report in reports):
        sys.exit(1)

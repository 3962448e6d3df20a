"""`deepring data check`: is this download usable?"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from deepring.data.check import check
from deepring.data.check_table import report_lines
from deepring.data.readers import reader_names
from deepring.progress import progress_bar


def data_command(arguments: Sequence[str]) -> None:
    """``deepring data check ROOT``; exits with 1 where a session or a scan file is unusable."""
    parser = argparse.ArgumentParser("deepring data")
    commands = parser.add_subparsers(dest="command", required=True)
    checker = commands.add_parser("check", help="read every scan of a dataset and report")
    checker.add_argument("root", type=Path)
    checker.add_argument("--format", choices=reader_names(), help="told from the folder by default")
    checker.add_argument("--session", help="one session only")
    args = parser.parse_args(arguments)

    with progress_bar("reading scans") as advance:
        reports = check(
            args.root,
            args.format,
            args.session,
            advance,
        )
    print("\n".join(report_lines(reports)))
    if not all(report.usable and not report.broken for report in reports):
        sys.exit(1)

"""`deepring data check`: what a dataset holds, what is doubtful about it, and what to change."""

import argparse
import sys

from deepring.cli.mistakes import MISTAKE
from deepring.data.inspection.check import check
from deepring.data.inspection.check_json import report_json
from deepring.data.inspection.check_text import report_lines
from deepring.progress import progress_bar
from deepring.text import printable

DOUBTFUL = 1
#: Exit status of each verdict.
_STATUS = {"good": 0, "doubtful": DOUBTFUL, "unusable": MISTAKE}


def data_command(args: argparse.Namespace) -> None:
    """Print what each session holds; exit with 1 if one is doubtful, with 2 if one is unusable."""
    with progress_bar("reading scans") as bar:
        reports = check(args.root, args.format, args.session, bar)
    status = max(_STATUS[report.verdict] for report in reports)
    if args.form == "json":
        print(report_json(args.root, reports, status))
    else:
        print("\n".join(map(printable, report_lines(reports))))
    if status:
        sys.exit(status)

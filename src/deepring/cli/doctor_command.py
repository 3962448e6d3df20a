"""`deepring doctor`: what a bug report needs to say, and whether commands can work here."""

import argparse
import sys

from deepring.cli.json_output import print_json
from deepring.diagnosis.diagnosis import diagnose
from deepring.diagnosis.diagnosis_text import as_text, as_values, without_names
from deepring.progress import progress_bar

FAILS = 1


def doctor_command(args: argparse.Namespace) -> None:
    """Print the diagnosis; exit with 1 if something makes commands fail."""
    with progress_bar("measuring steps") as bar:
        diagnosis = diagnose(args.cache, bar)
    hide = str if args.full else without_names
    if args.form == "json":
        print_json("diagnosis", as_values(diagnosis, hide))
    else:
        print(as_text(diagnosis, hide))
    if not diagnosis.works:
        sys.exit(FAILS)

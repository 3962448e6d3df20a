"""`deepring`: parse the command line, then run one command."""

import argparse
import sys
import traceback
from collections.abc import Sequence
from typing import Any

from deepring.cli.commands import COMMANDS, command_line
from deepring.cli.mistakes import BUG, MISTAKE, report_mistakes
from deepring.cli.output_streams import open_streams, written_out
from deepring.cli.parser import load, words
from deepring.cli.process import tune_process
from deepring.cli.stop_signals import sigterm_interrupts


def main(argv: Sequence[str] | None = None) -> None:
    """Entry point: run a command; a user's mistake is one line and exit status 2.

    A bug is a traceback and exit status 70, which no finding of a command has.
    """
    open_streams()
    try:
        with sigterm_interrupts(), report_mistakes({}), written_out():
            args = parse(sys.argv[1:] if argv is None else argv)
            with report_mistakes(args.flags):
                run(args)
    except Exception:
        traceback.print_exc()
        print("this is a bug: please report it, with what deepring doctor prints", file=sys.stderr)
        sys.exit(BUG)


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """The arguments of a command, with ``work`` and ``flags``. Exits for help and for mistakes."""
    name = argv[0] if argv else None
    parser = command_line(name)
    if name is None:
        parser.print_help()
        sys.exit(MISTAKE)
    if not name.startswith("-") and name not in COMMANDS:
        parser.error(f"{name}: no such command, expected {words(list(COMMANDS))}")
    return parser.parse_args(argv)


def run(args: argparse.Namespace) -> Any:
    """Import the function that does the work, and call it. Raises the errors of the library."""
    tune_process()
    return load(args.work)(args)


if __name__ == "__main__":
    main()

"""`deepring`: train, evaluate, simulate, data check."""

import argparse
import sys
from collections.abc import Sequence

from deepring import __version__
from deepring.cli.process import tune_process
from deepring.cli.report import mistakes_reported

USAGE = """\
deepring COMMAND ...

commands:
  train     train DeepRING and evaluate it       deepring train experiment=demo
  evaluate  evaluate methods on a test region    deepring evaluate data=sim_nclt
  simulate  write a simulated dataset            deepring simulate nclt -o FOLDER
  data      look at a dataset before using it    deepring data check FOLDER

`deepring COMMAND --help` tells more. train and evaluate take Hydra overrides, KEY=VALUE.
"""


@mistakes_reported
def main(argv: Sequence[str] | None = None) -> None:
    """Entry point: hand the rest of the command line to one command."""
    parser = argparse.ArgumentParser("deepring", usage=USAGE, add_help=False)
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("--version", action="version", version=f"deepring {__version__}")
    parser.add_argument("command", nargs="?", choices=["train", "evaluate", "simulate", "data"])
    arguments = list(sys.argv[1:] if argv is None else argv)
    chosen = parser.parse_args(arguments[:1])
    if chosen.help or chosen.command is None:
        print(USAGE, end="")
        sys.exit(0 if chosen.help else 2)
    rest = arguments[1:]
    tune_process()
    # Imported late: torch and Lightning take seconds, and --help should not.
    match chosen.command:
        case "train":
            from deepring.cli.experiments import train_command

            train_command(rest)
        case "evaluate":
            from deepring.cli.experiments import evaluate_command

            evaluate_command(rest)
        case "simulate":
            from deepring.cli.simulate import simulate_command

            simulate_command(rest)
        case "data":
            from deepring.cli.data import data_command

            data_command(rest)


if __name__ == "__main__":
    main()

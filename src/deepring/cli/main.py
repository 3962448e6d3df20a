"""`deepring`: the commands, each imported when it is called."""

import argparse
import sys
from collections.abc import Sequence

from deepring import __version__
from deepring.cli.process import tune_process
from deepring.cli.report import mistakes_reported

USAGE = """\
deepring COMMAND ...

commands:
  train       train DeepRING and evaluate it       deepring train experiment=demo
              or sweep over what is varied         deepring train -m ablation=table3
  evaluate    evaluate methods on a test region    deepring evaluate data=sim_nclt
  tables      tables of a sweep's finished runs    deepring tables FOLDER
  case-study  why sinograms: SG against PG         deepring case-study DATASET
  simulate    write a simulated dataset            deepring simulate nclt -o FOLDER
  data        look at a dataset before using it    deepring data check FOLDER

`deepring COMMAND --help` tells more. train and evaluate take Hydra overrides, KEY=VALUE.
"""


COMMANDS = ("train", "evaluate", "tables", "case-study", "simulate", "data")


@mistakes_reported
def main(argv: Sequence[str] | None = None) -> None:
    """Entry point: hand the rest of the command line to one command."""
    parser = argparse.ArgumentParser("deepring", usage=USAGE, add_help=False)
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("--version", action="version", version=f"deepring {__version__}")
    parser.add_argument("command", nargs="?", choices=COMMANDS)
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
        case "tables":
            from deepring.cli.tables import tables_command

            tables_command(rest)
        case "case-study":
            from deepring.cli.case_study import case_study_command

            case_study_command(rest)
        case "simulate":
            from deepring.cli.simulate import simulate_command

            simulate_command(rest)
        case "data":
            from deepring.cli.data import data_command

            data_command(rest)


if __name__ == "__main__":
    main()

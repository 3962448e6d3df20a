"""`deepring`: which command is meant."""

import argparse
import importlib
import sys
from collections.abc import Sequence

from deepring import __version__
from deepring.cli.console import mistakes_reported
from deepring.cli.process import tune_process

USAGE = """\
deepring COMMAND ...

commands:
  train       train a method and evaluate it       deepring train experiment=demo
              or sweep over what is varied         deepring train -m sweep=table3
  evaluate    evaluate methods on a test region    deepring evaluate data=sim_nclt
  compare     train and evaluate all methods       deepring compare
  score       score exported descriptors again     deepring score FOLDER
  tables      tables of a sweep's finished runs    deepring tables FOLDER
  case-study  why sinograms: SG against PG         deepring case-study DATASET
  map         build a map, or look at one          deepring map build FOLDER -o MAP
  localize    where were scans taken?              deepring localize MAP SCAN...
  loops       loop closures of a drive             deepring loops FOLDER -o OUT
  report      a run as one HTML page               deepring report outputs/demo/latest
  export      a trained network as one file        deepring export CHECKPOINT -o FILE
  simulate    write a simulated dataset            deepring simulate nclt -o FOLDER
  data        look at a dataset before using it    deepring data check FOLDER

`deepring COMMAND --help` tells more. train and evaluate take Hydra overrides, KEY=VALUE.
"""


#: Where each command lies, imported when it is called: torch and Lightning take seconds, and
#: --help should not.
COMMANDS = {
    "train": "deepring.cli.train_commands:train_command",
    "evaluate": "deepring.cli.train_commands:evaluate_command",
    "compare": "deepring.cli.compare_command:compare_command",
    "score": "deepring.cli.score_command:score_command",
    "tables": "deepring.cli.tables_command:tables_command",
    "case-study": "deepring.cli.case_study_command:case_study_command",
    "map": "deepring.cli.map_command:map_command",
    "localize": "deepring.cli.localize_command:localize_command",
    "loops": "deepring.cli.loops_command:loops_command",
    "report": "deepring.cli.report_command:report_command",
    "export": "deepring.cli.export_command:export_command",
    "simulate": "deepring.cli.simulate_command:simulate_command",
    "data": "deepring.cli.data_command:data_command",
}


@mistakes_reported
def main(argv: Sequence[str] | None = None) -> None:
    """Entry point: hand the rest of the command line to one command."""
    parser = argparse.ArgumentParser("deepring", usage=USAGE, add_help=False)
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("--version", action="version", version=f"deepring {__version__}")
    parser.add_argument("command", nargs="?", choices=list(COMMANDS))
    arguments = list(sys.argv[1:] if argv is None else argv)
    chosen = parser.parse_args(arguments[:1])
    if chosen.help or chosen.command is None:
        print(USAGE, end="")
        sys.exit(0 if chosen.help else 2)
    tune_process()
    module, function = COMMANDS[chosen.command].split(":")
    getattr(importlib.import_module(module), function)(arguments[1:])


if __name__ == "__main__":
    main()

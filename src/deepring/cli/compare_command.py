"""`deepring compare`: train and evaluate all methods, and print Tables I and II."""

import argparse
import sys
from collections.abc import Iterator

from deepring.cli.console import console
from deepring.cli.json_output import print_json
from deepring.cli.main import parse
from deepring.cli.tables_command import make_tables
from deepring.cli.train_commands import report_sweep, run_multirun, say_failed, sweep_content
from deepring.errors import ConfigError
from deepring.experiment.sweep_outcomes import SweepOutcomes

#: The override of each option, with the values in place of {}.
_OPTIONS = {"train": "train={}", "seeds": "seed={}", "test": "test=[{}]"}


def compare_command(args: argparse.Namespace) -> None:
    """Run both sweeps and print their tables; finished runs are skipped."""
    if args.learned == args.fixed == "":
        raise ConfigError("--learned, --fixed: both empty, expected at least one method; name one")
    sweeps: list[SweepOutcomes] = []
    for kind, overrides in _sweeps(args):
        sweeps.append(run_multirun(["-m", f"sweep={kind}", *overrides, *args.overrides]))
        if args.form != "json":
            report_sweep(sweeps[-1])
        else:
            say_failed(sweeps[-1])
    finished = [folder for outcomes in sweeps for folder in outcomes.finished]
    failed = any(outcomes.failed for outcomes in sweeps)
    of_tables = None
    if folders := dict.fromkeys(folder.parent for folder in finished):
        of_tables = make_tables(parse(["tables", *map(str, folders), "--as", args.form]))
    if args.form == "json":
        print_json("sweep", {**sweep_content(sweeps), "tables": of_tables})
    if failed:
        if args.form != "json":
            console.print("the same command goes on with what is left")
        sys.exit(1)


def _sweeps(args: argparse.Namespace) -> Iterator[tuple[str, list[str]]]:
    """The kinds of sweep to run, with the overrides of their options."""
    for kind in ("fixed", "learned"):
        methods = getattr(args, kind)
        if methods == "":
            continue
        overrides = [] if methods is None else [f"method={methods}"]
        for option, override in _OPTIONS.items():
            value = getattr(args, option)
            if value is not None and not (option == "train" and kind == "fixed"):
                overrides.append(override.format(value))
        yield kind, overrides

"""`deepring compare`: train and evaluate all methods, and print Tables I and II."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from deepring.cli.console import console
from deepring.cli.main import parse, run
from deepring.cli.train_commands import report_sweep, run_multirun
from deepring.errors import ConfigError

#: The override of each option, with the values in place of {}.
_OPTIONS = {"train": "train={}", "seeds": "seed={}", "test": "test=[{}]"}


def compare_command(args: argparse.Namespace) -> None:
    """Run both sweeps and print their tables; finished runs are skipped."""
    if args.learned == args.fixed == "":
        raise ConfigError("--learned, --fixed: both empty, expected at least one method; name one")
    finished: list[Path] = []
    failed = 0
    for kind, overrides in _sweeps(args):
        outcomes = run_multirun(["-m", f"sweep={kind}", *overrides, *args.overrides])
        finished += outcomes.finished
        failed += report_sweep(outcomes)
    sweeps = dict.fromkeys(folder.parent for folder in finished)
    if sweeps:
        run(parse(["tables", *map(str, sweeps)]))
    if failed:
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

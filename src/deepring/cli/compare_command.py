"""`deepring compare`: train and evaluate all methods, print Tables I and II, and write a page."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import get_args

from deepring.checks import one_of
from deepring.cli.console import console
from deepring.cli.json_output import print_json
from deepring.cli.main import parse
from deepring.cli.mistakes import error_message, is_mistake
from deepring.cli.named_methods import ALL
from deepring.cli.overrides import checked, choices_of
from deepring.cli.report_command import PAGE, write_page
from deepring.cli.tables_command import make_tables
from deepring.cli.train_commands import (
    from_here,
    report_sweep,
    run_multirun,
    say_failed,
    sweep_content,
    sweep_overrides,
)
from deepring.errors import ConfigError
from deepring.evaluation.metrics import Over
from deepring.experiment.compose import composed, expect_no_data
from deepring.experiment.config import Config
from deepring.experiment.config_groups import config_folder
from deepring.experiment.dataset_columns import lacking_columns
from deepring.experiment.entries import method_entries
from deepring.experiment.every_method import Kind, every_method
from deepring.experiment.planned_jobs import plan_together
from deepring.experiment.sweep_names import swept
from deepring.experiment.sweep_outcomes import SweepOutcomes
from deepring.experiment.sweep_page import sweep_page
from deepring.text import printable

#: The override of each option, with the values in place of {}.
_OPTIONS = {"train": "train={}", "seeds": "seed={}", "test": "test=[{}]"}


def compare_command(args: argparse.Namespace) -> None:
    """Run both sweeps, print their tables, and write their page; finished runs are skipped."""
    if args.learned == args.fixed == "":
        raise ConfigError("--learned, --fixed: both empty, expected at least one method; name one")
    expect_no_data(args.overrides)
    parts = [[f"sweep={kind}", *own, *args.overrides] for kind, own in _sweeps(args)]
    if len(parts) > 1:  # so that `deepring status` knows the jobs of both from the beginning
        plan_together([sweep_overrides(["-m", *part])[1:] for part in parts])
    sweeps: list[SweepOutcomes] = []
    for part in parts:
        sweeps.append(run_multirun(["-m", *part]))
        if args.form != "json":
            report_sweep(sweeps[-1], next_steps=False)
        else:
            say_failed(sweeps[-1])
    finished = [folder for outcomes in sweeps for folder in outcomes.finished]
    failed = any(outcomes.failed for outcomes in sweeps)
    of_tables, page, trouble = None, None, None
    if folders := list(dict.fromkeys(from_here(folder.parent) for folder in finished)):
        wanted = parse(["tables", *map(str, folders), "--as", args.form])
        of_tables = make_tables(wanted)
        page, trouble = _page(folders, wanted.radius, one_of("over", wanted.over, Over))
    if args.form == "json":
        print_json("sweep", {**sweep_content(sweeps), "tables": of_tables, "page": page})
    elif page is not None:
        console.print(f"report       {page}")
    if trouble is not None and not is_mistake(trouble):
        raise trouble
    if failed and args.form != "json":
        console.print("the same command goes on with what is left")
    if failed or trouble is not None:
        sys.exit(1)


def _page(
    folders: Sequence[Path], radius: float, over: Over
) -> tuple[Path | None, Exception | None]:
    """Write the page of the comparison beside its tables; where that fails the tables stay.

    Returns its path, or why there is none, which is said where it is a mistake and no bug.
    """
    path = folders[0] / PAGE
    try:
        write_page(path, sweep_page(folders, radius, over, path.parent))
    except Exception as error:
        if is_mistake(error):
            reason = error_message(error, {})
            print(printable(f"no page      {path}: {reason}"), file=sys.stderr)
        return None, error
    return path, None


def _sweeps(args: argparse.Namespace) -> Iterator[tuple[Kind, list[str]]]:
    """The kinds of sweep to run, with the overrides of their options."""
    for kind in reversed(get_args(Kind)):  # those that are done first
        methods = _methods(kind, args)
        if methods == "":
            continue
        overrides = [] if methods is None else [f"method={methods}"]
        for option, override in _OPTIONS.items():
            value = getattr(args, option)
            if value is not None and not (option == "train" and kind == "fixed"):
                overrides.append(override.format(value))
        yield kind, overrides


def _methods(kind: Kind, args: argparse.Namespace) -> str | None:
    """The names that an option gives; for ``all`` they are looked up, and what they are is said."""
    names: str | None = getattr(args, kind)
    if names is None or ALL not in names.split(","):
        return names
    if names != ALL:
        raise ConfigError(f"--{kind}: {names}, expected {ALL} alone, or names of methods")
    choice = every_method(
        kind,
        method_entries(config_folder()),
        lambda columns: lacking_columns(_data(kind, args), columns),
    )
    if args.form == "json":
        print(f"{kind}: {choice}", file=sys.stderr)
    else:
        console.print(f"{kind:<12} {choice}")
    return ",".join(choice.names)


def _data(kind: Kind, args: argparse.Namespace) -> Config:
    """A config with all datasets that a sweep trains and tests on."""
    own = [text for text in checked(["-m", *args.overrides])[1:] if not choices_of(text)[1:]]
    overrides = [f"sweep={kind}", *own]
    usual = swept(kind, config_folder())
    seeds = usual["seed"] if args.seeds is None else args.seeds
    overrides.append(f"seed={choices_of(f'seed={seeds}')[0]}")
    if kind == "learned":
        trains = choices_of(f"train={usual['train'] if args.train is None else args.train}")
        overrides.append(f"train=[{','.join(trains)}]")
    if args.test is not None:
        overrides.append(f"test=[{args.test}]")
    return composed(overrides)

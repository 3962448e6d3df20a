"""`deepring compare`: train what is not trained, evaluate all, print Tables I and II."""

import argparse
import sys
from collections.abc import Iterator, Sequence

from deepring.cli.console import console
from deepring.cli.sweeps import report_sweep
from deepring.cli.tables_command import tables_command
from deepring.cli.train_commands import run_multirun
from deepring.errors import DeepringError

#: An option of the command, the key it sets, and how several values are written in a sweep.
_OPTIONS = {"train": "train={}", "seeds": "seed={}", "test": "test=[{}]"}


def compare_command(arguments: Sequence[str]) -> None:
    """``deepring compare [options] [KEY=VALUE ...]``; what has finished before is skipped."""
    args = _parser().parse_intermixed_args(arguments)
    if args.learned == args.fixed == "":
        raise DeepringError("--learned, --fixed: both empty; expected at least one method")
    finished, failed = [], 0
    for kind, overrides in _sweeps(args):
        done = run_multirun(["-m", f"sweep={kind}", *overrides, *args.overrides])
        finished += done.finished
        failed += report_sweep(done)
    folders = list(dict.fromkeys(folder.parent for folder in finished))
    if folders:
        tables_command([str(folder) for folder in folders])
    if failed:
        console.print("the same command goes on with what is left")
        sys.exit(1)


def _sweeps(args: argparse.Namespace) -> Iterator[tuple[str, list[str]]]:
    """The kinds of sweep to run, and what the options set in each."""
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "deepring compare",
        description="Train each method on each training dataset, evaluate all methods on all test "
        "datasets, and print the paper's Tables I and II. What has finished is skipped, what was "
        "stopped goes on.",
        epilog="Lists are separated by commas, without spaces. KEY=VALUE are further Hydra "
        "overrides, such as hydra/launcher=joblib or test_data.kitti.root=FOLDER.",
    )
    parser.add_argument(
        "--learned", metavar="METHODS", help="of conf/method; the CPU-sized four by default"
    )
    parser.add_argument(
        "--fixed",
        metavar="METHODS",
        help="that learn nothing; RING, RING++ and both Scan Contexts by default",
    )
    parser.add_argument(
        "--train", metavar="DATASETS", help="one after the other, of conf/data; two by default"
    )
    parser.add_argument("--test", metavar="DATASETS", help="all, of conf/data; two by default")
    parser.add_argument("--seeds", metavar="SEEDS", help="0,1 by default")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    return parser

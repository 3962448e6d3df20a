"""Time of `--help` of every command, and until `localize` answers and `train` takes its first step.

    python benchmarks/startup.py [--runs 3] [DATASET]

DATASET is the folder of a simulated one in NCLT's layout, as ``deepring simulate nclt`` writes it;
a map is built of it and its rasters are cached before. Every command runs in a process of its own.
The least of the runs counts: everything else on the machine only adds to it. Processor time is that
of all threads, user and system; without other programs, the wall clock says less than that.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from deepring.cli.commands import COMMANDS

INNER = {"map": ("build", "info", "calibrate", "merge"), "data": ("check",)}

COMMAND = (sys.executable, "-m", "deepring.cli.main")

#: Ends the process as soon as the first batch of a training is done.
FIRST_STEP = """
import os, sys
from deepring.cli.main import main
from deepring.training.progress_callback import TrainingProgress

TrainingProgress.on_train_batch_end = lambda *_: os._exit(0)
main(["train", *sys.argv[1:]])
"""

#: A training that simulated streets of any size have scans for.
SMALL = ("experiment=demo", "sampling.ways=4", "data.regions.margin=1", "evaluate=false")


def seconds(command: Sequence[str], cwd: Path) -> tuple[float, float]:
    """Wall clock and processor time of one process."""
    before, start = os.times(), time.perf_counter()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run(command, check=True, cwd=cwd, **quiet)
    wall, after = time.perf_counter() - start, os.times()
    return wall, sum(after[2:4]) - sum(before[2:4])


def show(what: str, command: Sequence[str], runs: int, cwd: Path) -> None:
    walls, processors = zip(*(seconds(command, cwd) for _ in range(runs)), strict=True)
    print(f"{min(walls):6.2f} s, processor {min(processors):6.2f} s  {what}", flush=True)


def helps(runs: int, cwd: Path) -> None:
    commands = [[], *([name] for name in COMMANDS)]
    commands += [[name, inner] for name, inners in INNER.items() for inner in inners]
    for words in commands:
        show(" ".join(["deepring", *words, "--help"]), [*COMMAND, *words, "--help"], runs, cwd)


def answers(dataset: Path, runs: int, cwd: Path) -> None:
    session, other = sorted(path for path in dataset.iterdir() if (path / "velodyne_sync").is_dir())
    scan = min((other / "velodyne_sync").glob("*.bin"))
    built = ["map", "build", str(dataset), "--session", session.name, "-o", "a.map"]
    subprocess.run([*COMMAND, *built], check=True, cwd=cwd, stdout=subprocess.DEVNULL)
    show("deepring localize a.map SCAN", [*COMMAND, *_localize(scan)], runs, cwd)
    train = [sys.executable, "-c", FIRST_STEP, *SMALL, f"data.root={dataset}"]
    seconds(train, cwd)  # fills the cache
    show("deepring train, until the first step", train, runs, cwd)


def _localize(scan: Path) -> list[str]:
    return ["localize", "a.map", str(scan), "--format", "nclt"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path, nargs="?", metavar="DATASET")
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        helps(args.runs, Path(folder))
        if args.dataset is not None:
            answers(args.dataset.absolute(), args.runs, Path(folder))


if __name__ == "__main__":
    main()

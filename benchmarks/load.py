"""Time and memory at full size: 200 000 places, 28 000 scans a session, a million points a scan.

    python benchmarks/load.py [--places 200000] [--scans 28000] [--points 1000000] [--check]

Each task runs in a process of its own with one thread, so that the peak of its memory is its own,
in a temporary folder of some 3 GB. Growing states the seconds that ten thousand places more take,
at the beginning and at the end. ``--check`` exits with 1 if a figure is beyond its limit: memory
is stated to within a third, time to within a factor of some five, since machines differ.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

TASKS = ("grow", "locate", "verify", "session", "dense")


class Limit(NamedTuple):
    """The most that a figure at full size may be."""

    seconds: float
    megabytes: float


LIMITS = {
    "10 000 places more": Limit(6, 1800),
    "save a map": Limit(50, 3000),
    "open a map": Limit(5, 450),
    "locate the first scan": Limit(12, 1500),
    "locate a scan": Limit(2.5, 1500),
    "open a map, all bytes checked": Limit(12, 1500),
    "open a session": Limit(30, 1000),
    "check its poses": Limit(2, 1000),
    "inspect it": Limit(10, 1000),
    "read a scan": Limit(1, 600),
    "draw it from above": Limit(0.1, 600),
    "describe it": Limit(1, 600),
    "locate it": Limit(1.5, 600),
}

#: How much longer the last ten thousand places may take than the first.
GROWTH = 3.0


def problems(figures: list[dict]) -> list[str]:
    """The figures beyond their limits, in words."""
    words = []
    for found in figures:
        limit = LIMITS[found["what"]]
        for name, value in limit._asdict().items():
            if found[name] > value:
                words.append(f"{found['what']}: {found[name]:.1f} {name}, limit {value:g}")
    more = [found["seconds"] for found in figures if found["what"] == "10 000 places more"]
    if len(more) > 2 and sorted(more)[len(more) // 2] > GROWTH * more[0]:
        words.append(
            f"10 000 places more: {more[0]:.2f} s at the beginning, half of them beyond {GROWTH:g} "
            "times that; limit: as long at the end as at the beginning"
        )
    return words


def rows(figures: list[dict]) -> list[str]:
    """The figures as a table in Markdown; of growing, the first and the last."""
    lines = ["| | n | seconds | peak MB |", "| --- | ---: | ---: | ---: |"]
    growing = [k for k, found in enumerate(figures) if found["what"] == "10 000 places more"]
    for k, found in enumerate(figures):
        if k in growing[1:-1]:
            continue
        seconds = f"{found['seconds']:.3g}"
        lines.append(f"| {found['what']} | {found['n']} | {seconds} | {found['megabytes']:.0f} |")
    return lines


def measured(task: str, folder: Path, sizes: list[str]) -> list[dict]:
    """The figures of one task, from a process of its own."""
    command = [sys.executable, __file__, "--measure", task, "--folder", str(folder), *sizes]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--places", type=int, default=200_000)
    parser.add_argument("--scans", type=int, default=28_000)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--tasks", default=",".join(TASKS), help="separated by commas, in order")
    parser.add_argument("--check", action="store_true", help="hold the figures against the limits")
    for flag in ("--measure", "--folder"):  # how it calls itself
        parser.add_argument(flag, help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.measure:
        measure(args)
        return
    sizes = [f"--{name}={getattr(args, name)}" for name in ("places", "scans", "points")]
    figures: list[dict] = []
    with tempfile.TemporaryDirectory() as folder:
        for task in args.tasks.split(","):
            figures += measured(task, Path(folder), sizes)
    print("\n".join(rows(figures)))
    if args.check and (found := problems(figures)):
        sys.exit("\n".join(found))


def measure(args: argparse.Namespace) -> None:
    """Run one task in this process and print its figures as JSON."""
    from dataclasses import asdict

    from load_tasks import TASKS as FUNCTIONS
    from load_tasks import Size

    size = Size(args.places, args.scans, args.points)
    print(json.dumps([asdict(found) for found in FUNCTIONS[args.measure](Path(args.folder), size)]))


if __name__ == "__main__":
    main()

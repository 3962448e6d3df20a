"""Processor time, user and system, of `--help` of every command, in a process of its own each.

    python benchmarks/startup.py [--runs 3]

The least of the runs counts: everything else on the machine only adds to it.
"""

import argparse
import os
import subprocess
import sys

from deepring.cli.commands import COMMANDS

INNER = {"map": ("build", "info", "calibrate"), "data": ("check",)}


def processor_seconds(words: list[str]) -> float:
    """User and system time of one ``deepring ... --help``."""
    before = os.times()
    command = [sys.executable, "-m", "deepring.cli.main", *words, "--help"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    commands = [[], *([name] for name in COMMANDS)]
    commands += [[name, inner] for name, inners in INNER.items() for inner in inners]
    for words in commands:
        seconds = min(processor_seconds(words) for _ in range(runs))
        print(f"{seconds:6.2f} s  deepring {' '.join([*words, '--help'])}", flush=True)


if __name__ == "__main__":
    main()

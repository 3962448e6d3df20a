"""`deepring simulate`: write a simulated dataset in a native layout."""

import argparse
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from deepring.cli.console import console
from deepring.errors import DeepringError
from deepring.progress import progress_bar
from deepring.simulation.settings import SimulationSettings, preset, with_knobs
from deepring.simulation.simulate import simulate


def simulate_command(arguments: Sequence[str]) -> None:
    """``deepring simulate {nclt,mulran} -o FOLDER [--seed N] [KNOB=VALUE ...]``."""
    parser = argparse.ArgumentParser(
        "deepring simulate",
        description="Write two sessions over one simulated world in the native layout of a "
        "dataset. An interrupted run goes on when started again; a finished one is left alone.",
        epilog="knobs: " + ", ".join(f.name for f in fields(SimulationSettings)),
    )
    parser.add_argument("dataset", choices=["nclt", "mulran"])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("knobs", nargs="*", metavar="KNOB=VALUE")
    args = parser.parse_intermixed_args(arguments)

    knobs = dict(_parse_knob(text) for text in args.knobs)
    settings = with_knobs(preset(args.dataset, args.seed), knobs)
    with progress_bar(f"simulating {args.dataset} scans") as progress:
        root = simulate(settings, args.output, workers=args.workers, progress=progress)
    console.print(f"dataset      {root}")


def _parse_knob(text: str) -> tuple[str, object]:
    """``name=value`` with the value as the knob's type. Raises DeepringError."""
    name, equals, value = text.partition("=")
    known = {field.name: field for field in fields(SimulationSettings)}
    if not equals or name not in known:
        raise DeepringError(f"{text!r} is no knob; expected NAME=VALUE, NAME of {', '.join(known)}")
    whole = known[name].type in (int, int | None)
    try:
        return name, int(value) if whole else float(value)
    except ValueError:
        kind = "a whole number" if whole else "a number"
        raise DeepringError(f"{name}: {value!r}, expected {kind}") from None

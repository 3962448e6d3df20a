"""`deepring simulate`: write a simulated dataset in a native layout."""

import argparse
from dataclasses import fields
from typing import Any, get_args

from deepring.cli.console import console
from deepring.cli.json_output import show_written
from deepring.cli.options import expect_folder
from deepring.errors import ConfigError
from deepring.progress import progress_bar
from deepring.simulation.presets import preset, with_knobs
from deepring.simulation.settings import SimulationSettings
from deepring.simulation.simulate import simulate


def simulate_command(args: argparse.Namespace) -> None:
    """Simulate the dataset unless it exists, and print its folder."""
    knobs = dict(parse_knob(text) for text in args.knobs)
    settings = with_knobs(preset(args.dataset, args.seed), knobs)
    expect_folder(args.output)
    with progress_bar(f"simulating {args.dataset} scans") as bar:
        root = simulate(settings, args.output, workers=args.workers, progress=bar)
    show_written(args, [root], lambda: console.print(f"dataset      {root}"))


def parse_knob(text: str) -> tuple[str, object]:
    """Name and value of ``NAME=VALUE``, the value in the knob's type. Raises ConfigError."""
    name, equals, value = text.partition("=")
    settings = {field.name: field for field in fields(SimulationSettings)}
    if not equals or name not in settings:
        raise ConfigError(
            f"{text}: not a knob, expected NAME=VALUE with a NAME of {', '.join(settings)}"
        )
    return name, _value(name, value, settings[name].type)


def _value(name: str, text: str, kind: Any) -> object:
    """``text`` as ``kind``, the type of the knob, e.g. ``int | None``. Raises ConfigError."""
    kinds = get_args(kind) or (kind,)
    if type(None) in kinds and text.lower() == "none":
        return None
    if bool in kinds:
        if text.lower() not in ("true", "false"):
            raise ConfigError(f"{name}: {text!r}, expected true or false")
        return text.lower() == "true"
    if int not in kinds and float not in kinds:
        return text
    try:
        return int(text) if int in kinds else float(text)
    except ValueError:
        noun = "a whole number" if int in kinds else "a number"
        raise ConfigError(f"{name}: {text!r}, expected {noun}") from None

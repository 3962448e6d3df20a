"""What `--as json` prints: one object on standard output, whose ``schema`` says what it holds."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from deepring.io.stated_json import json_text


def print_json(name: str, content: Mapping[str, Any], indent: int | None = 2) -> None:
    """Print one object of the schema ``name``."""
    print(json_text(name, content, indent))


def print_as(
    args: argparse.Namespace,
    name: str,
    content: Callable[[], Mapping[str, Any]],
    text: Callable[[], None],
) -> None:
    """Print the content where the command was given ``--as json``, or else call ``text``."""
    if args.form == "json":
        print_json(name, content())
    else:
        text()


def show_written(
    args: argparse.Namespace, written: Sequence[Path], text: Callable[[], None]
) -> None:
    """`print_as` for a command that writes files and has nothing else to tell."""
    print_as(args, "written", lambda: {"command": args.command, "written": list(written)}, text)

"""`deepring completion`: a script that lets a shell complete commands, options and overrides."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import shtab

from deepring.cli.commands import command_line
from deepring.cli.parser import HydraParser, MixedParser, Parser

#: What a shell does with the groups of configs; they stand in place of @OVERRIDES@.
_PREAMBLE = {
    "bash": """\
# GROUP=OPTION of Hydra; bash takes the equals sign for a word of its own.
_deepring_overrides() {
  local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" key=""
  if [[ $word == "=" ]]; then key=$before; word=""
  elif [[ $before == "=" ]]; then key=${COMP_WORDS[COMP_CWORD-2]}; fi
  local words="@OVERRIDES@"
  local one
  for one in $words; do
    if [[ -z $key && $one == "$word"* ]]; then echo "$one"
    elif [[ -n $key && $one == "$key=$word"* ]]; then echo "${one#*=}"; fi
  done
}
""",
    "zsh": """\
_deepring_overrides() {
  local words="@OVERRIDES@"
  compadd -S '' -- ${(s: :)words}
}
""",
}

#: The folders and files among the arguments, by the names that help texts give them.
_FOLDERS = ("FOLDER", "PATH", "RUN")
_FILES = ("MAP", "FILE", "SCAN", "SCANS", "DATA", "CHECKPOINT", "DATASET | FILE", "A", "B", "OUT")


def completion_command(args: argparse.Namespace) -> None:
    """Print the script for a shell. It needs nothing but the shell when it runs."""
    parser = command_line()
    for leaf in _leaves(parser):
        _name_files(leaf)
    words = " ".join(_overrides())
    preamble = {shell: text.replace("@OVERRIDES@", words) for shell, text in _PREAMBLE.items()}
    print(shtab.complete(parser, args.shell, preamble=cast("Any", preamble)))  # a str by its hint


def _overrides() -> Iterator[str]:
    """GROUP=OPTION for every option that can be chosen on the command line."""
    from deepring.experiment.config_groups import config_folder, group_options

    for group, options in group_options(config_folder()).items():
        yield from (f"{group}={option}" for option in options)


def _leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The parsers that run something."""
    inner = [action for action in parser._actions if isinstance(action.choices, dict)]
    if not inner:
        yield parser
    for action in inner:
        for leaf in dict(action.choices or {}).values():
            yield from _leaves(leaf)


def _name_files(leaf: argparse.ArgumentParser) -> None:
    """Say which arguments are files, folders and overrides, as shtab reads it off actions."""
    hydra = isinstance(leaf, HydraParser) or (isinstance(leaf, MixedParser) and _has_groups(leaf))
    for action in leaf._actions:
        metavar = str(action.metavar)
        if action.dest == "overrides" and hydra:
            action.complete = {"bash": "_deepring_overrides", "zsh": "_deepring_overrides"}  # type: ignore[attr-defined]
        elif metavar in _FOLDERS or (action.type is Path and metavar not in _FILES):
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif metavar in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif action.choices is not None and not isinstance(action.choices, dict):
            action.choices = list(action.choices)  # names are imported when they are listed


def _has_groups(leaf: Parser) -> bool:
    return any(action.dest == "overrides" for action in leaf._actions)

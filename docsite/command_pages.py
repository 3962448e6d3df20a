"""A page for each command of `deepring`, out of its parser."""

import argparse
import re
from collections.abc import Iterator

from docsite.markdown import cell, table

FOLDER = "reference/commands"


def command_pages() -> dict[str, str]:
    """The Markdown of the commands' pages by path."""
    from deepring.cli.commands import COMMANDS, command_line

    leaves = _commands(command_line())
    rows = [[f"[`deepring {name}`]({name}.md)", cell(COMMANDS[name].summary)] for name in leaves]
    index = [
        "# Commands",
        "`deepring COMMAND --help` prints the same. A mistake ends a command with status 2 and one "
        "line that says what was expected.",
        table(["command", "what it does"], rows),
    ]
    pages = {f"{FOLDER}/index.md": "\n\n".join(index) + "\n"}
    for name in leaves:
        parser = next(iter(_commands(command_line(name), name).values()))
        pages[f"{FOLDER}/{name}.md"] = "\n\n".join(_page(parser)) + "\n"
    return pages


def options(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """The arguments of a parser that a user can give, --help and subcommands left out."""
    left_out = (argparse._HelpAction, argparse._SubParsersAction)
    return [action for action in parser._actions if not isinstance(action, left_out)]


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The subcommands of a parser by name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _commands(
    parser: argparse.ArgumentParser, only: str | None = None
) -> dict[str, argparse.ArgumentParser]:
    return {name: each for name, each in subparsers(parser).items() if only in (None, name)}


def _page(parser: argparse.ArgumentParser, level: int = 1) -> Iterator[str]:
    yield f"{'#' * level} {parser.prog}"
    yield _escaped(parser.description or "")
    yield f"```text\n{_usage(parser)}\n```"
    rows = [[_flags(action), cell(_escaped(_help(parser, action)))] for action in options(parser)]
    if rows:
        yield table(["argument", "what it is"], rows)
    for inner in subparsers(parser).values():
        yield from _page(inner, level + 1)
    if parser.epilog:
        yield f"```text\n{parser.epilog.strip()}\n```"


def _usage(parser: argparse.ArgumentParser) -> str:
    """How a command is called, with further lines a little to the right."""
    return re.sub(r"\n +", "\n    ", parser.format_usage().removeprefix("usage: ").rstrip())


def _flags(action: argparse.Action) -> str:
    value = _value(action)
    if not action.option_strings:
        return f"`{value}`"
    return ", ".join(
        f"`{flag} {value}`" if value else f"`{flag}`" for flag in action.option_strings
    )


def _value(action: argparse.Action) -> str:
    """The value of an option as the usage shows it; nothing for a switch."""
    if action.nargs == 0:
        return ""
    names = action.metavar or (
        "{" + ",".join(map(str, action.choices)) + "}" if action.choices else None
    )
    if isinstance(names, tuple):
        return " ".join(names)
    return names or (action.dest.upper() if action.option_strings else action.dest)


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    text = parser._get_formatter()._expand_help(action) if action.help else ""
    return f"{text}; required" if action.required and action.option_strings else text


def _escaped(text: str) -> str:
    """Text that is no Markdown, as Markdown: only code in backticks keeps its meaning."""
    parts = text.split("`")
    for i in range(0, len(parts), 2):
        for sign in ("*", "_", "<", "[", "]"):
            parts[i] = parts[i].replace(sign, "\\" + sign)
    return "`".join(parts)

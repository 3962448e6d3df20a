"""Parsers on top of argparse: short errors, lazily imported choices, one leaf per command."""

import argparse
import importlib
import math
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NoReturn

from deepring.cli.mistakes import MISTAKE
from deepring.text import printable

#: Messages of argparse, and our own in their place.
_ERRORS = (
    (r"argument (.+?): invalid choice: (.+?) \(choose from (.+)\)", r"\1: \2, expected one of \3"),
    (r"argument (.+?): (.+)", r"\1: \2"),
    (r"the following arguments are required: (.+)", r"missing: \1"),
    (r"unrecognized arguments: (.+)", r"unknown: \1"),
)


class Parser(argparse.ArgumentParser):
    """A parser that knows the function that does the work, and the flags of its arguments."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.flags: dict[str, str] = {}
        super().__init__(*args, **kwargs | {"allow_abbrev": False})

    def add_argument(self, *args: Any, **kwargs: Any) -> argparse.Action:
        """Add an argument, as argparse does, and remember its flag."""
        action = super().add_argument(*args, **kwargs)
        if action.option_strings:
            self.flags[action.dest] = action.option_strings[-1]
        elif action.dest in ("root", "roots"):  # the library's name of a folder of data
            self.flags["root"] = str(action.metavar)
        return action

    def runs(self, work: str, **flags: str) -> None:
        """Set the function that does the work: ``module:function``, imported after parsing.

        ``flags`` are those of arguments that have another name in the library.
        """
        self.set_defaults(work=work, flags=self.flags | flags)

    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one line on standard error."""
        for theirs, ours in _ERRORS:
            if re.fullmatch(theirs, message, re.DOTALL):
                message = re.sub(theirs, ours, message, flags=re.DOTALL)
                break
        print(f"error: {printable(message)}; see {self.prog} --help", file=sys.stderr)
        sys.exit(MISTAKE)


class MixedParser(Parser):
    """A parser that allows KEY=VALUE arguments before, between and after options."""

    _mixing = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, with arguments between options."""
        if self._mixing:
            return super().parse_known_args(args, namespace)
        self._mixing = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._mixing = False


class HydraParser(Parser):
    """A parser that leaves its arguments to Hydra, as ``overrides``, except --help and --as."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Take all arguments as they are, but for the form of the output."""
        words, form = self._without_form(list(args or ()))
        if {"-h", "--help"} & set(words):
            return super().parse_known_args(["--help"], namespace)
        parsed = argparse.Namespace() if namespace is None else namespace
        vars(parsed).update(self._defaults, overrides=words, form=form)
        return parsed, []

    def _without_form(self, words: list[str]) -> tuple[list[str], str]:
        """The arguments without ``--as FORM``, and the form, by default the first choice."""
        (action,) = (action for action in self._actions if action.dest == "form")
        forms = list(action.choices or ())
        left, form = [], forms[0]
        rest = iter(words)
        for word in rest:
            flag, equals, value = word.partition("=")
            if flag != "--as":
                left.append(word)
                continue
            form = value if equals else next(rest, "")
            if form not in forms:
                self.error(f"--as: {form or 'no value'}, expected one of {', '.join(forms)}")
        return left, form


class Names:
    """The names that the function ``module:function`` returns; it is imported on first use."""

    def __init__(self, where: str) -> None:
        self.where = where

    def __iter__(self) -> Iterator[str]:
        return iter(load(self.where)())

    def __contains__(self, name: object) -> bool:
        return name in list(self)


def load(where: str) -> Any:
    """The object at ``module:attribute``."""
    module, attribute = where.split(":")
    return getattr(importlib.import_module(module), attribute)


def whole(least: int) -> Callable[[str], int]:
    """The type of an option that takes a whole number of at least ``least``."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"{text}, expected a whole number of at least {least}")
        return value

    return parse


def number(least: float = -math.inf, unit: str = "") -> Callable[[str], float]:
    """The type of an option that takes a finite number of at least ``least``."""
    expected = f"a number of {unit}" if unit else "a number"
    expected += f", at least {least:g}" if math.isfinite(least) else ""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < least:
            raise argparse.ArgumentTypeError(f"{text}, expected {expected}")
        return value

    return parse


def subcommands(parser: Parser) -> Callable[..., Parser]:
    """Start the subcommands of a parser, and return the function that adds one."""

    def make(*, kind: type[Parser] = Parser, **kwargs: Any) -> Parser:
        return kind(**kwargs)

    options: dict[str, Any] = {"dest": "command", "metavar": "COMMAND", "title": "commands"}
    options |= {"required": True, "parser_class": make}
    add: Callable[..., Parser] = parser.add_subparsers(**options).add_parser
    return add


def words(names: Sequence[str]) -> str:
    """Names as a list in a sentence: a, b or c."""
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)

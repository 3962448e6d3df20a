"""How the command line meets its user: errors in one line, tables, where things lie."""

import functools
import sys
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from rich.console import Console

from deepring.errors import DeepringError

P = ParamSpec("P")
R = TypeVar("R")

#: Exit status of a user's mistake, as argparse and Hydra-less tools have it.
MISTAKE = 2

#: Where output goes to a file or a pipe it is wide enough for every table.
console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 110)


def mistakes_reported(command: Callable[P, R]) -> Callable[P, R]:
    """Print a DeepringError as one line on standard error and exit with status 2."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except DeepringError as error:
            print(f"error: {error}", file=sys.stderr)
            sys.exit(MISTAKE)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(130)

    return wrapped

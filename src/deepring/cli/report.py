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
    """Print a user's mistake as an error on standard error, and exit with status 2.

    That is: our own errors, what Hydra says of a config, and what the operating system says of
    a file. Anything else is a bug and keeps its traceback.
    """

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except (DeepringError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(130)
        except Exception as error:
            if not _about_the_config(error):
                raise
            cause = f"\n{error.__cause__}" if error.__cause__ else ""
            print(f"error: {error}{cause}", file=sys.stderr)
        sys.exit(MISTAKE)

    return wrapped


def _about_the_config(error: Exception) -> bool:
    """Whether Hydra or OmegaConf raised it; asked by module, so that neither is imported."""
    modules = {cls.__module__.partition(".")[0] for cls in type(error).__mro__}
    return bool(modules & {"hydra", "omegaconf"})

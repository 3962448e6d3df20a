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

#: Exit status after Ctrl-C.
INTERRUPTED = 130

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
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(INTERRUPTED)
        except Exception as error:
            if not is_mistake(error):
                raise
            ours = isinstance(error, DeepringError | OSError)
            cause = f"\n{error.__cause__}" if error.__cause__ and not ours else ""
            print(f"error: {error}{cause}", file=sys.stderr)
        sys.exit(MISTAKE)

    return wrapped


def is_mistake(error: Exception) -> bool:
    """Whether the user can mend it: an error of ours, of the config, or about a file.

    Hydra's and OmegaConf's are told by module, so that neither is imported: by that of the error,
    and by that which raised it, since they say of some overrides so with a plain ValueError.
    """
    modules = {cls.__module__.partition(".")[0] for cls in type(error).__mro__}
    if isinstance(error, ValueError):
        modules.add(_raised_in(error).partition(".")[0])
    return isinstance(error, DeepringError | OSError) or bool(modules & {"hydra", "omegaconf"})


def _raised_in(error: Exception) -> str:
    """Name of the module whose code raised the error; empty where it was never raised."""
    name, trace = "", error.__traceback__
    while trace is not None:
        name, trace = str(trace.tb_frame.f_globals.get("__name__", "")), trace.tb_next
    return name

"""A user's mistake as one line on standard error, in the words of the command line."""

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from deepring.cli.config_mistakes import config_mistake
from deepring.errors import DeepringError, StoppedError
from deepring.io.files import reason_of

#: Exit status of a user's mistake, as of argparse.
MISTAKE = 2

#: Exit status after Ctrl-C.
INTERRUPTED = 130

#: An argument in a message of the library: its first word, or a word in backticks.
_ARGUMENT = re.compile(r"^[a-z_]+(?:\.[a-z_]+)*(?=:| =)|`([a-z_]+(?:\.[a-z_]+)*)`")


@contextmanager
def report_mistakes(flags: Mapping[str, str]) -> Iterator[None]:
    """Print a user's mistake as an error on standard error, and exit with status 2.

    An interrupted training is told likewise, and the status is 130. Mistakes are our own errors,
    those of Hydra about a config, and those of the operating system about a file. Any other error
    is a bug and keeps its traceback.

    Args:
        flags: the flags of the library's arguments, by name.
    """
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not is_mistake(error):
            raise
        print(f"error: {error_message(error, flags)}", file=sys.stderr)
        sys.exit(INTERRUPTED if isinstance(error, StoppedError) else MISTAKE)


def error_message(error: Exception, flags: Mapping[str, str]) -> str:
    """The message of an error, with flags in place of the arguments that it names."""
    message = with_flags(_text(error), flags)
    flag = flags.get(getattr(error, "argument", None) or "")
    return message if flag is None or flag in message else f"{message} ({flag})"


def with_flags(message: str, flags: Mapping[str, str]) -> str:
    """The message with each argument of the library replaced by its flag.

    An argument is the first word before a colon or an equals sign, or any word in backticks. If a
    dotted name is unknown, its last part counts.

    >>> with_flags("format: 'x', expected one of nclt, kitti", {"format": "--format"})
    "--format: 'x', expected one of nclt, kitti"
    >>> with_flags("a.bag has several topics: give `topic`", {"topic": "--topic"})
    'a.bag has several topics: give --topic'
    """

    def flag(match: re.Match[str]) -> str:
        name = match[1] or match[0]
        return flags.get(name) or flags.get(name.rpartition(".")[2]) or match[0]

    return _ARGUMENT.sub(flag, message)


def is_mistake(error: Exception) -> bool:
    """Whether the user can correct it: an error of ours, about the config, or about a file.

    Errors of Hydra and OmegaConf are recognised by module, so that neither is imported: by the
    module of the class, and by the module that raised it, since both also raise ValueErrors.
    """
    modules = {cls.__module__.partition(".")[0] for cls in type(error).__mro__}
    if isinstance(error, ValueError):
        modules.add(_raised_in(error).partition(".")[0])
    return isinstance(error, DeepringError | OSError) or bool(modules & {"hydra", "omegaconf"})


def _text(error: Exception) -> str:
    if isinstance(error, DeepringError):
        return str(error)
    mistake = config_mistake(error)
    if mistake is not None:
        return mistake
    if isinstance(error, OSError):
        message = reason_of(error)
        return message if error.filename in (None, "") else f"{error.filename}: {message}"
    text = f"{error}\n{error.__cause__}" if error.__cause__ else str(error)
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())


def _raised_in(error: Exception) -> str:
    """Name of the module whose code raised the error; empty where it was never raised."""
    name, trace = "", error.__traceback__
    while trace is not None:
        name, trace = str(trace.tb_frame.f_globals.get("__name__", "")), trace.tb_next
    return name

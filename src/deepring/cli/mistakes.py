"""A user's mistake as one line on standard error, in the words of the command line."""

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from deepring.cli.stop_signals import stop_status
from deepring.errors import DeepringError, StoppedError
from deepring.io.files import text_of
from deepring.text import printable

#: Exit status of a user's mistake, as of argparse.
MISTAKE = 2

#: Exit status of a bug, that of an internal error in sysexits.h.
BUG = 70

#: An argument in a message of the library: its first word, or a word in backticks.
_ARGUMENT = re.compile(r"^[a-z_]+(?:\.[a-z_]+)*(?=:| =)|`([a-z_]+(?:\.[a-z_]+)*)`")


@contextmanager
def report_mistakes(flags: Mapping[str, str]) -> Iterator[None]:
    """Print a user's mistake as an error on standard error, and exit with status 2.

    An interrupted training is told likewise, with `stop_status`. Mistakes are our own errors
    and those of the operating system about a file. Any other error is a bug and keeps its
    traceback.

    Args:
        flags: the flags of the library's arguments, by name.
    """
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(stop_status())
    except Exception as error:
        if not is_mistake(error):
            raise
        print(f"error: {_shown(error_message(error, flags), error)}", file=sys.stderr)
        sys.exit(stop_status() if isinstance(error, StoppedError) else MISTAKE)


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


def _shown(message: str, error: Exception) -> str:
    """What prints of a message. Our own errors may have further lines, that of a system has one."""
    lines = message.split("\n") if isinstance(error, DeepringError) else [message]
    return "\n".join(map(printable, lines))


def is_mistake(error: Exception) -> bool:
    """Whether the user can correct it: an error of ours, or of the operating system on a file."""
    return isinstance(error, DeepringError | OSError)


def _text(error: Exception) -> str:
    return text_of(error) if isinstance(error, OSError) else str(error)

"""A user's mistake as one line on standard error, in the words of the command line."""

import errno
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from deepring.cli.config_mistakes import config_mistake
from deepring.errors import DeepringError, StoppedError

#: Exit status of a user's mistake, as argparse has it.
MISTAKE = 2

#: Exit status after Ctrl-C.
INTERRUPTED = 130

#: What is wrong with a file, for the errors of the operating system that a user can mend.
_FILE_ERRORS = {
    errno.ENOENT: "no such file or folder",
    errno.EACCES: "no permission to read or write it",
    errno.EPERM: "no permission to read or write it",
    errno.EROFS: "lies on a read-only disk",
    errno.EISDIR: "is a folder, expected a file",
    errno.ENOTDIR: "lies below a file, expected folders above it",
    errno.EEXIST: "exists, expected a new file",
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.ENAMETOOLONG: "the name is too long",
}

#: An argument of the library in one of its messages: the first word, or in backticks.
_ARGUMENT = re.compile(r"^[a-z_]+(?:\.[a-z_]+)*(?=:| =)|`([a-z_]+(?:\.[a-z_]+)*)`")


@contextmanager
def mistakes_reported(flags: Mapping[str, str]) -> Iterator[None]:
    """Print a user's mistake as an error on standard error, and exit with status 2.

    An interrupted training is told likewise, and the status is 130. Mistakes are our own errors,
    what Hydra says about a config, and what the operating system says about a file. Any other
    error is a bug and keeps its traceback.

    Args:
        flags: the flag of each argument that the library's messages may name.
    """
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not is_mistake(error):
            raise
        print(f"error: {told(error, flags)}", file=sys.stderr)
        sys.exit(INTERRUPTED if isinstance(error, StoppedError) else MISTAKE)


def told(error: Exception, flags: Mapping[str, str]) -> str:
    """What an error says, with the flags of the arguments that it names or asks for."""
    message = in_flags(_text(error), flags)
    flag = flags.get(getattr(error, "argument", None) or "")
    return message if flag is None or flag in message else f"{message} ({flag})"


def in_flags(message: str, flags: Mapping[str, str]) -> str:
    """The message with each argument of the library replaced by its flag.

    An argument is the first word before a colon or an equals sign, or any word in backticks; of
    a dotted name the last part counts where the whole is not known.

    >>> in_flags("format: 'x', expected one of nclt, kitti", {"format": "--format"})
    "--format: 'x', expected one of nclt, kitti"
    >>> in_flags("a.bag has several topics: give `topic`", {"topic": "--topic"})
    'a.bag has several topics: give --topic'
    """

    def flag(match: re.Match[str]) -> str:
        name = match[1] or match[0]
        return flags.get(name) or flags.get(name.rpartition(".")[2]) or match[0]

    return _ARGUMENT.sub(flag, message)


def is_mistake(error: Exception) -> bool:
    """Whether the user can mend it: an error of ours, about the config, or about a file.

    Hydra's and OmegaConf's errors are told by module, so that neither is imported: the module of
    the error's class, and the module that raised it, since they raise plain ValueErrors too.
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
        known = _FILE_ERRORS.get(error.errno or 0, error.strerror or str(error))
        return known if error.filename in (None, "") else f"{error.filename}: {known}"
    said = f"{error}\n{error.__cause__}" if error.__cause__ else str(error)
    return "; ".join(line.strip() for line in said.splitlines() if line.strip())


def _raised_in(error: Exception) -> str:
    """Name of the module whose code raised the error; empty where it was never raised."""
    name, trace = "", error.__traceback__
    while trace is not None:
        name, trace = str(trace.tb_frame.f_globals.get("__name__", "")), trace.tb_next
    return name

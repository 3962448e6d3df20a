"""Errors that a user can fix. The command line prints them without a traceback."""

from collections.abc import Sequence

from deepring.text import printable

#: Characters of a message; the rest of a longer one is cut off.
_LONGEST = 4000


class DeepringError(ValueError):
    """A user's mistake or unusable input: what is wrong, where, and what to do.

    A message may name files, and hold text out of them: it is one line, and what does not print is
    escaped.

    Args:
        message: see above.
        argument: name of the argument to change, so that the command line can name its flag.
        lines: further lines below the message.
    """

    def __init__(
        self, message: str = "", argument: str | None = None, lines: Sequence[str] = ()
    ) -> None:
        text = "\n".join(map(printable, (message, *lines)))
        super().__init__(text if len(text) <= _LONGEST else f"{text[:_LONGEST]}...")
        self.argument = argument


class ConfigError(DeepringError):
    """A setting, argument or option with an invalid value."""


class DataError(DeepringError):
    """Scans, poses or descriptors that cannot be used."""


class FileError(DeepringError):
    """A file that is missing, damaged, in an unexpected format, or cannot be written."""


class BrokenScanError(DataError):
    """A scan that cannot be decoded or shows nothing. Datasets skip, count and report it."""


class StoppedError(DeepringError):
    """The user interrupted the work; the message says how to resume it."""

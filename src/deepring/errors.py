"""Errors that a user can fix. The command line prints them without a traceback."""


class DeepringError(ValueError):
    """A user's mistake or unusable input: what is wrong, where, and what to do.

    ``argument`` is the name of the argument to change, so that the command line can name its flag.
    """

    def __init__(self, message: str = "", argument: str | None = None) -> None:
        super().__init__(message)
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

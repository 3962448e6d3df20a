"""Errors that a user can mend. The command line prints them without a traceback."""


class DeepringError(ValueError):
    """A user's mistake or unusable input: what is wrong, where, and what to do.

    ``argument`` names the argument that would mend it, where the message alone does not let a
    caller tell, such as a command line that adds its flag.
    """

    def __init__(self, message: str = "", argument: str | None = None) -> None:
        super().__init__(message)
        self.argument = argument


class ConfigError(DeepringError):
    """A setting, an argument or an option that cannot be used."""


class DataError(DeepringError):
    """Scans, poses or descriptors that cannot be used."""


class FileError(DeepringError):
    """A file that is missing, damaged, of another format, or cannot be written."""


class BrokenScanError(DataError):
    """One scan file that cannot be decoded. Sessions skip, count and report these."""


class StoppedError(DeepringError):
    """The user stopped the work; the message says how to go on."""

"""Errors that a user can mend. The command line prints them without a traceback."""


class DeepringError(Exception):
    """A user's mistake or unusable input: what is wrong, where, and what to do."""


class BrokenScanError(DeepringError):
    """One scan file that cannot be decoded. Sessions skip, count and report these."""


class StoppedError(DeepringError):
    """The user stopped the work; the message says how to go on."""

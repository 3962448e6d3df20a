"""What a command says besides its result: one line on standard error."""

import sys


def warn(message: str) -> None:
    """Print a warning; nothing for an empty message."""
    if message:
        print(f"warning: {message}", file=sys.stderr)


def warn_of_skipped(name: str, skipped: object) -> None:
    """Say what the reader of a session skipped, if anything; see `SkippedScans`."""
    if str(skipped):
        warn(f"session {name}: left out {skipped}")

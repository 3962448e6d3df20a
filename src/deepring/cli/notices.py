"""What a command says besides its result: one line on standard error."""

import sys
from typing import TYPE_CHECKING

from deepring.text import printable

if TYPE_CHECKING:
    from deepring.data.recording import Recording
    from deepring.data.session import Session


def warn(message: str) -> None:
    """Print a warning; nothing for an empty message."""
    if message:
        print(f"warning: {printable(message)}", file=sys.stderr)


def say_skipped(session: "Session | Recording") -> None:
    """Say which scans the reader of a session skipped, and which rows of its poses.

    The latter is no warning: the first poses of every drive of NCLT are NaN.
    """
    skipped = session.skipped
    message = f"session {session.name}: left out {skipped}"
    if skipped.broken or skipped.without_pose:
        warn(message)
    elif str(skipped):
        print(f"note: {printable(message)}", file=sys.stderr)

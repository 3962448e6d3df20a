"""The handler of log lines: standard error as it is when a line is written."""

import logging
import sys
from typing import Any, TextIO


class StderrHandler(logging.StreamHandler):
    """Writes to the present standard error, which a progress bar replaces while it is drawn.

    A line then stands above the bar, and not in the middle of it.
    """

    def __init__(self, stream: object = None) -> None:
        del stream  # of Hydra's own config, with which ours is merged
        logging.Handler.__init__(self)

    @property
    def stream(self) -> TextIO:
        """Standard error."""
        return sys.stderr

    @stream.setter
    def stream(self, value: Any) -> None:
        """Whatever is set, it stays standard error."""

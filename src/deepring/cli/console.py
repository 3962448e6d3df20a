"""The console that commands print to."""

import sys

from rich.console import Console

#: In a file or a pipe, lines are wide enough for every table.
console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 110)

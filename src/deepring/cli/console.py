"""The console that commands print to."""

import sys

from rich.console import Console

#: Where output goes to a file or a pipe it is wide enough for every table.
console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 110)

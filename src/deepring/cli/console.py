"""The console that commands print to."""

import sys
from typing import Any

from rich.console import Console
from rich.text import Text

from deepring.text import printable


class PlainConsole(Console):
    """Prints texts as they are: what stands in a file's name is neither markup nor control."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, soft_wrap=True, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """A text, or a cell of a table, with its control characters as escapes."""
        return super().render_str(printable(text), **options)


#: In a file or a pipe, lines are wide enough for every table.
console = PlainConsole(width=None if sys.stdout.isatty() else 110)

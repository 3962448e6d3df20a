"""The console that commands print to."""

import os
import sys
from typing import Any

from rich.console import Console, ConsoleDimensions
from rich.text import Text

from deepring.text import printable


def columns() -> int:
    """The width that COLUMNS states; 80 where it states none."""
    stated = os.environ.get("COLUMNS", "")
    return int(stated) if stated.isdecimal() and int(stated) > 0 else 80


class PlainConsole(Console):
    """Prints texts as they are: what stands in a file's name is neither markup nor control.

    It is as wide as the terminal, or as COLUMNS says; 80 columns in a file or a pipe.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, soft_wrap=True, **options)

    @property  # type: ignore[misc]  # nobody sets it
    def size(self) -> ConsoleDimensions:
        """Columns and lines."""
        if sys.stdout.isatty():
            return super().size
        return ConsoleDimensions(columns(), 25)

    def render_str(self, text: str, **options: Any) -> Text:
        """A text, or a cell of a table, with its control characters as escapes."""
        return super().render_str(printable(text), **options)


console = PlainConsole()

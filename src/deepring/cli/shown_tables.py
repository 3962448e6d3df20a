"""The tables of `deepring tables`: printed, written, and kept for JSON."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deepring.cli.console import console
from deepring.io.files import replacing
from deepring.reports.style import save
from deepring.reports.table import Table, csv, latex, markdown
from deepring.reports.terminal_table import terminal
from deepring.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What a file holds, by the ending of its name.
_WHAT = {".md": "table", ".tex": "latex", ".csv": "numbers"}


class ShownTables:
    """Prints tables and writes them into a folder.

    Args:
        folder: where they are written.
        quiet: print nothing; what is to be said goes to standard error.
    """

    def __init__(self, folder: Path, *, quiet: bool) -> None:
        self.folder, self.quiet = folder, quiet
        self.shown: dict[str, Table] = {}
        self.numbers: dict[str, Table] = {}
        self.written: list[Path] = []

    def print(self, tables: Mapping[str, Table]) -> None:
        """Print the tables, which have names."""
        self.shown.update(tables)
        if not self.quiet:
            console.print(terminal(list(tables.values())))

    def say(self, line: str) -> None:
        """Print a line beside the tables."""
        if self.quiet:
            print(f"note: {printable(line)}", file=sys.stderr)
        else:
            console.print(line)

    def write_shown(self, name: str) -> None:
        """Write a table that was printed, as Markdown and LaTeX."""
        table = self.shown[name]
        self._write(f"{name}.md", markdown([table]))
        self._write(f"{name}.tex", latex(table))

    def write_numbers(self, name: str, table: Table) -> None:
        """Write every number of a table in full, as CSV."""
        self.numbers[name] = table
        self._write(f"{name}.csv", csv(table))

    def write_figure(self, name: str, figure: "Figure") -> None:
        """Write a figure as PNG."""
        path = self.folder / f"{name}.png"
        save(figure, path)
        self._wrote("figure", path)

    def content(self) -> dict[str, Any]:
        """All tables, as printed and in full, and the files, for the schema ``tables``."""
        shown = (_texts(name, table) for name, table in self.shown.items())
        numbers = (_values(name, table) for name, table in self.numbers.items())
        return {"shown": list(shown), "numbers": list(numbers), "written": self.written}

    def _write(self, name: str, text: str) -> None:
        path = self.folder / name
        with replacing(path) as temporary:
            temporary.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")
        self._wrote(_WHAT[path.suffix], path)

    def _wrote(self, what: str, path: Path) -> None:
        self.written.append(path)
        if not self.quiet:
            console.print(f"{what:<12} {path}")


def _texts(name: str, table: Table) -> dict[str, Any]:
    """A table as it is printed."""
    return {
        "name": name,
        "title": table.title,
        "headers": list(table.headers),
        "rows": [[cell.text for cell in row] for row in table.rows],
        "notes": list(table.notes),
    }


def _values(name: str, table: Table) -> dict[str, Any]:
    """A table in full: a mapping a row; "" is null, and ``seeds`` a list."""
    return {
        "name": name,
        "rows": [
            {
                header: cell.text if column < table.names else _value(header, cell.text)
                for column, (header, cell) in enumerate(zip(table.headers, row, strict=True))
            }
            for row in table.rows
        ],
    }


def _value(header: str, text: str) -> Any:
    if header == "seeds":
        return [int(seed) for seed in text.split()]
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text

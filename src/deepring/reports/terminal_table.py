"""Tables on the terminal, as wide as it is: where it is narrow, numbers stand below each other."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import zip_longest
from textwrap import wrap

from rich import box
from rich import table as rich_table
from rich.console import Console, ConsoleOptions
from rich.text import Text

from deepring.reports.table import Cell, Table, printable_table

#: Least width of a column of names, and the width from which on names are not broken up more so
#: that numbers stay on one line.
_NARROW, _COMFORTABLE = 8, 16

#: Blanks at both edges of a table, and between two columns.
_EDGES, _BETWEEN = 2, 2


class TerminalTables:
    """Tables one below the other, for a console of rich."""

    def __init__(self, tables: Sequence[Table]) -> None:
        self.tables = tables

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterable[Text | rich_table.Table]:
        """The tables as they fit."""
        del console
        width = options.max_width
        for table in map(printable_table, self.tables):
            yield from _paragraph(table.title, width)
            yield _rich(*_fitted(table, width))
            for note in table.notes:
                yield from _paragraph(note, width)
            if table.notes:
                yield Text("")


def terminal(tables: Sequence[Table]) -> TerminalTables:
    """The tables for the terminal, one below the other.

    On a narrow one, what stands behind a number ("0.859 ± 0.010 (.80-.91)") comes below it, and
    names are broken into lines.
    """
    return TerminalTables(tables)


def _fitted(table: Table, width: int) -> tuple[Table, list[int]]:
    """The table in rows of a line each, and the widths of its columns of names."""
    room = width - _EDGES - _BETWEEN * (len(table.headers) - 1)
    names = [_width(table, column) for column in range(table.names)]
    numbers = [_width(table, column) for column in range(table.names, len(table.headers))]
    if sum(names) + sum(numbers) <= room:
        return table, names
    stacked = sum(min(name, _COMFORTABLE) for name in names) + sum(numbers) > room
    if stacked:
        numbers = [
            max(len(part) for cell in _column(table, column) for part in _parts(cell))
            for column in range(table.names, len(table.headers))
        ]
    while sum(names) + sum(numbers) > room and max(names) > _NARROW:
        names[names.index(max(names))] -= 1
    return _in_lines(table, names, stacked), names


def _in_lines(table: Table, widths: Sequence[int], stacked: bool) -> Table:
    """The table with each row in as many rows as it has lines."""
    rows: list[list[Cell]] = []
    breaks = []
    for number, row in enumerate(table.rows):
        if number in table.breaks:
            breaks.append(len(rows))
        columns = [
            [Cell(line, cell.bold) for line in wrap(cell.text, width, break_on_hyphens=False)]
            for cell, width in zip(row[: table.names], widths, strict=True)
        ]
        for cell in row[table.names :]:
            number_text, *further = _parts(cell.text) if stacked else [cell.text]
            columns.append([Cell(number_text, cell.bold), *map(Cell, further)])
        rows += [list(line) for line in zip_longest(*columns, fillvalue=Cell(""))]
    return replace(table, rows=rows, breaks=breaks)


def _parts(text: str) -> list[str]:
    """A number, and what stands behind it, the brackets of an interval left out.

    >>> _parts("0.859 ± 0.010 (.80-.91)"), _parts("90/100")
    (['0.859', '± 0.010', '.80-.91'], ['90/100'])
    """
    number, *further = re.split(r" (?=[±(])", text)
    return [number, *(part.strip("()") for part in further)]


def _column(table: Table, column: int) -> list[str]:
    return [table.headers[column], *(row[column].text for row in table.rows)]


def _width(table: Table, column: int) -> int:
    return max(map(len, _column(table, column)))


def _paragraph(text: str, width: int) -> list[Text]:
    return [Text(line) for line in wrap(text, width, break_on_hyphens=False)] or [Text("")]


def _rich(table: Table, widths: Sequence[int]) -> rich_table.Table:
    rich = rich_table.Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for index, header in enumerate(table.headers):
        if index < table.names:
            rich.add_column(Text(header), width=widths[index], overflow="fold")
        else:
            rich.add_column(Text(header), justify="right", no_wrap=True)
    for number, row in enumerate(table.rows):
        if number in table.breaks:
            rich.add_section()
        # Text, not markup: a method may be called "ring[fast]".
        rich.add_row(*(Text(text, style="bold" if bold else "") for text, bold in row))
    return rich

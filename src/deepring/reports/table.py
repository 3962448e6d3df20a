"""Tables of text, and how they are written as Markdown, LaTeX and CSV."""

import csv as csv_format
import io
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from deepring.errors import DataError
from deepring.text import printable

#: Text of a missing value.
NONE = "-"


class Cell(NamedTuple):
    """Text of one cell, and whether it is bold."""

    text: str
    bold: bool = False


@dataclass(frozen=True)
class Table:
    """Rows that can be compared with each other. Raises DataError for a row of another length.

    The first ``names`` columns name the row, the others hold numbers. A rule stands before each
    row whose index is in ``breaks``; ``notes`` stand below the table.
    """

    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    names: int
    breaks: Collection[int] = ()
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows):
            if len(row) != len(self.headers):
                raise DataError(
                    f"rows[{number}]: {len(row)} cells; expected one per header, "
                    f"{len(self.headers)}"
                )


def best_bold(
    texts: Sequence[str], best: Callable[[Iterable[float]], float] | None = max
) -> list[Cell]:
    """Cells of one column, with the best of at least two numbers in bold.

    The numbers are compared as they are written, so that equal texts are equally good. A text
    begins with its number ("0.859", "0.859 ± 0.010"), or is "-". If ``best`` is None, no cell is
    bold.
    """
    if best is None:
        return [Cell(text) for text in texts]
    numbers = [None if text == NONE else float(text.split()[0]) for text in texts]
    values = [number for number in numbers if number is not None]
    top = best(values) if len(values) > 1 else None
    return [
        Cell(text, number is not None and number == top)
        for text, number in zip(texts, numbers, strict=True)
    ]


def rate_text(value: float | None) -> str:
    """A share to three digits; "-" for none."""
    return NONE if value is None else f"{value:.3f}"


def full_text(value: float | None) -> str:
    """A number with all its digits; "" for none."""
    return "" if value is None else repr(value)


def short_text(value: float) -> str:
    """Three digits that count, no exponent: '0.0123', '123'."""
    return f"{float(f'{value:.3g}'):g}"


def markdown(tables: Sequence[Table]) -> str:
    """The tables, one below the other, ending in a newline; notes are a list."""
    lines = []
    for table in map(printable_table, tables):
        rule = ["---" if index < table.names else "---:" for index in range(len(table.headers))]
        headers = [_md(header) for header in table.headers]
        cells = [
            [f"**{text}**" if bold else text for text, bold in _escaped(row)] for row in table.rows
        ]
        rows = [f"| {' | '.join(row)} |" for row in (headers, rule, *cells)]
        lines += [_md(table.title), "", *rows, ""]
        if table.notes:
            lines += [*(f"- {_md(note)}" for note in table.notes), ""]
    return "\n".join(lines)


def _escaped(row: Sequence[Cell]) -> Iterable[Cell]:
    return (Cell(_md(text), bold) for text, bold in row)


def _md(text: str) -> str:
    """Text of a cell or a line; Markdown would take the brackets of tags for HTML."""
    return text.replace("|", r"\|").replace("<", r"\<")


def printable_table(table: Table) -> Table:
    """The table with its texts on one line each, and without characters that do not print."""
    return replace(
        table,
        title=printable(table.title),
        headers=[printable(header) for header in table.headers],
        rows=[[Cell(printable(text), bold) for text, bold in row] for row in table.rows],
        notes=[printable(note) for note in table.notes],
    )


def latex(table: Table) -> str:
    r"""A ``table`` environment that needs ``\usepackage{booktabs}``, ending in a newline."""
    table = printable_table(table)
    columns = "l" * table.names + "r" * (len(table.headers) - table.names)
    lines = [
        r"\begin{table}[t]",
        r"\centering",
        rf"\caption{{{_tex(table.title)}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        _tex_row([Cell(header, bold=True) for header in table.headers]),
        r"\midrule",
    ]
    for number, row in enumerate(table.rows):
        if number in table.breaks:
            lines.append(r"\midrule")
        lines.append(_tex_row(row))
    lines += [r"\bottomrule", r"\end{tabular}"]
    lines += [rf"\par\footnotesize {_tex(note)}" for note in table.notes]
    return "\n".join([*lines, r"\end{table}", ""])


def _tex_row(row: Sequence[Cell]) -> str:
    cells = (rf"\textbf{{{_tex(text)}}}" if bold else _tex(text) for text, bold in row)
    return " & ".join(cells) + r" \\"


_TEX = str.maketrans(
    {
        **{character: f"\\{character}" for character in "&%$#_{}"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        # Either would be taken for an argument of the \\ that ends the row before.
        "[": "{[}",
        "*": "{*}",
        "±": r"$\pm$",
        "×": r"$\times$",
    }
)


def _tex(text: str) -> str:
    return text.translate(_TEX)


def csv(table: Table) -> str:
    """Headers and texts as CSV, without title and notes, ending in a newline."""
    buffer = io.StringIO()
    writer = csv_format.writer(buffer, lineterminator="\n")
    writer.writerow(table.headers)
    writer.writerows([cell.text for cell in row] for row in table.rows)
    return buffer.getvalue()

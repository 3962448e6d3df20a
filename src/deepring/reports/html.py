"""Self-contained HTML pages, without network, server or scripts."""

from collections.abc import Collection, Iterable, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Literal

from deepring.errors import FileError
from deepring.reports.escaping import escaped
from deepring.reports.indexed_png import data_uri
from deepring.reports.table import Cell, Table, printable_table

#: How much room pictures take, see `pictures_in_rows`.
Room = Literal["", "wide", "scans", "couples"]

_PNG = b"\x89PNG\r\n\x1a\n"


def page(title: str, parts: Iterable[str]) -> str:
    """The whole page; the parts are HTML already."""
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>\n{_style()}\n</style>\n</head>\n<body>\n"
        f"<h1>{escaped(title)}</h1>\n{body}\n</body>\n</html>\n"
    )


@cache
def _style() -> str:
    """How the elements of pages look."""
    return (files("deepring.reports") / "page.css").read_text(encoding="utf-8").strip()


def heading(text: str) -> str:
    """A section heading."""
    return f"<h2>{escaped(text)}</h2>"


def subheading(text: str) -> str:
    """A heading within a section."""
    return f"<h3>{escaped(text)}</h3>"


def lead(text: str) -> str:
    """What the page says first."""
    return f'<p class="lead">{escaped(text)}</p>'


def cards(numbers: Iterable[tuple[str, str]]) -> str:
    """Numbers beside each other, each with what it is."""
    items = "".join(
        f"<li><b>{escaped(number)}</b><span>{escaped(words)}</span></li>"
        for number, words in numbers
    )
    return f'<ul class="cards">{items}</ul>'


def soft(text: str) -> str:
    """A paragraph of less weight."""
    return f'<p class="soft">{escaped(text)}</p>'


def details(summary: str, parts: Iterable[str]) -> str:
    """Parts that are shown when they are asked for."""
    inside = "\n".join(parts)
    return f"<details><summary>{escaped(summary)}</summary>\n{inside}\n</details>"


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{escaped(text)}</p>"


def link(text: str, to: str | None) -> str:
    """A link to a file beside the page, quoted already; the text alone where there is none."""
    return escaped(text) if to is None else f'<a href="{escaped(to)}">{escaped(text)}</a>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: Collection[str] = ()) -> str:
    """A table of plain text; the columns of the names ``words`` hold words, the others numbers."""
    return table_of_html(head, ([*map(escaped, row)] for row in rows), words)


def table_of_html(
    head: Sequence[str], rows: Iterable[Sequence[str]], words: Collection[str] = ()
) -> str:
    """A table whose cells are HTML already, otherwise as `table`."""
    kinds = [_of_words(name in words) for name in head]
    cells = "".join(
        f'<th scope="col"{kind}>{escaped(name)}</th>'
        for name, kind in zip(head, kinds, strict=True)
    )

    def line(row: Sequence[str]) -> str:
        first, *rest = row
        values = (f"<td{kind}>{value}</td>" for value, kind in zip(rest, kinds[1:], strict=True))
        return f'<tr><th scope="row">{first}</th>{"".join(values)}</tr>'

    lines = "\n".join(map(line, rows))
    header = f"<thead><tr>{cells}</tr></thead>\n" if any(head) else ""
    kind = "" if header else ' class="facts"'
    return f'<div class="scroll"><table{kind}>\n{header}<tbody>\n{lines}\n</tbody></table></div>'


def shown_table(table: Table) -> str:
    """A table as documents have it: the best in bold, rules between groups, notes below."""
    table = printable_table(table)
    heads = enumerate(map(escaped, table.headers))
    cells = "".join(
        f'<th scope="col"{_of_words(number < table.names)}>{name}</th>' for number, name in heads
    )
    lines = []
    for number, row in enumerate(table.rows):
        rule = ' class="rule"' if number in table.breaks else ""
        words = "".join(_cell(*each, table.names) for each in enumerate(row))
        lines.append(f"<tr{rule}>{words}</tr>")
    notes = "".join(f"<li>{escaped(note)}</li>" for note in table.notes)
    below = f'\n<ul class="soft notes">{notes}</ul>' if notes else ""
    return (
        f'<div class="scroll"><table><caption>{escaped(table.title)}</caption>\n<thead><tr>{cells}'
        "</tr></thead>\n<tbody>\n" + "\n".join(lines) + f"\n</tbody></table></div>{below}"
    )


def _cell(column: int, cell: Cell, names: int) -> str:
    words = f"<b>{escaped(cell.text)}</b>" if cell.bold else escaped(cell.text)
    if column == 0:
        return f'<th scope="row">{words}</th>'
    return f"<td{_of_words(column < names)}>{words}</td>"


def _of_words(are: bool) -> str:
    """The class of a cell that holds words and no number."""
    return ' class="text"' if are else ""


def long_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], words: Collection[str] = ()
) -> str:
    """A `table` that is scrolled where it has many rows."""
    return f'<div class="long">{table(head, rows, words)}</div>'


def bullets(lines: Sequence[str], most: int | None = None) -> str:
    """A list of lines of plain text; of more than ``most`` it says how many there are besides."""
    listed = "\n".join(f"<li>{escaped(line)}</li>" for line in lines[:most])
    rest = 0 if most is None else len(lines) - most
    more = f"\n{paragraph(f'And {rest} more.')}" if rest > 0 else ""
    return f'<ul class="long">\n{listed}\n</ul>{more}'


def points(lines: Iterable[str]) -> str:
    """A short list of lines of plain text, all of it shown."""
    return "<ul>\n" + "\n".join(f"<li>{escaped(line)}</li>" for line in lines) + "\n</ul>"


def pictures_in_rows(pictures: Iterable[str], room: Room = "") -> str:
    """Pictures beside each other, as many as the window has room for.

    ``wide`` ones need more room, and those of ``scans`` less, as they have no words in them;
    ``couples`` are two of these each, which stay side by side.
    """
    return f'<div class="{room} row">\n' + "\n".join(pictures) + "\n</div>"


def figure(drawing: str, caption: str, kind: str = "") -> str:
    """A drawing, HTML already, with its caption; ``kind`` is the class of the whole."""
    of_kind = f' class="{kind}"' if kind else ""
    return f"<figure{of_kind}>{drawing}<figcaption>{escaped(caption)}</figcaption></figure>"


def preformatted(text: str) -> str:
    """A preformatted block."""
    lines = "\n".join(map(escaped, text.split("\n")))
    return f"<pre>{lines}</pre>"


def picture(file: Path, caption: str) -> str:
    """A PNG file, embedded in the page; the caption is also its alternative text.

    Raises FileError for a file that is none.
    """
    data = file.read_bytes()
    if file.is_symlink() or not data.startswith(_PNG):
        raise FileError(f"{file}: no PNG file, expected a figure of the run; delete it")
    return figure(f'<img src="{data_uri(data)}" alt="{escaped(caption)}">', caption)

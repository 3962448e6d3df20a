"""Self-contained HTML pages, without network, server or scripts."""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from deepring.errors import FileError
from deepring.reports.style import png
from deepring.text import printable, printable_lines

_PNG = b"\x89PNG\r\n\x1a\n"

#: Pixels of a page to an inch of a figure, and pixels of its file to one of the page.
_SCALE, _SHARPNESS = 110, 1.6

_STYLE = """
:root { color-scheme: light dark; --paper: #fff; --ink: #262626; --soft: #595959; --line: #d9d9d9;
  --block: #f6f6f6; }
@media (prefers-color-scheme: dark) { :root { --paper: #17191d; --ink: #e6e6e6; --soft: #a9adb3;
  --line: #3b3f46; --block: #23262c; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
h1, h2 { font-weight: 600; line-height: 1.2; overflow-wrap: anywhere; } h2 { margin-top: 2.5rem; }
p, li { overflow-wrap: anywhere; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; display: block;
  max-width: 100%; overflow-x: auto; }
th, td { padding: .25rem .75rem; text-align: right; border-bottom: 1px solid var(--line); }
th { white-space: nowrap; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
td:nth-child(n+3) { white-space: nowrap; }
.long { max-height: 32rem; overflow: auto; } .long td { white-space: nowrap; }
.long table { max-width: none; overflow: visible; }
figure { margin: 1.5rem 0; } img { max-width: 100%; height: auto; background: #fff;
  border-radius: .4rem; }
.row { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(15rem, 100%), 1fr));
  gap: 0 1.5rem; }
.wide.row { grid-template-columns: repeat(auto-fit, minmax(min(28rem, 100%), 1fr)); }
.row figure { margin: .75rem 0; }
figcaption { color: var(--soft); overflow-wrap: anywhere; }
pre { overflow-x: auto; background: var(--block); padding: 1rem; }
""".strip()


def page(title: str, parts: Iterable[str]) -> str:
    """The whole page; the parts are HTML already."""
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(title)}</title>\n<style>\n{_STYLE}\n</style>\n</head>\n<body>\n"
        f"<h1>{_text(title)}</h1>\n{body}\n</body>\n</html>\n"
    )


def _text(text: str) -> str:
    """Plain text as HTML, in an element or between the quotes of an attribute.

    What does not print is escaped first, so that no mark of direction turns the text around.
    """
    return html.escape(printable(text))


def heading(text: str) -> str:
    """A section heading."""
    return f"<h2>{_text(text)}</h2>"


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{_text(text)}</p>"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of plain text."""
    cells = "".join(f"<th>{_text(name)}</th>" for name in head)
    lines = [
        "<tr>" + "".join(f"<td>{_text(value)}</td>" for value in row) + "</tr>" for row in rows
    ]
    return f"<table>\n<tr>{cells}</tr>\n" + "\n".join(lines) + "\n</table>"


def long_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table that is scrolled where it has many rows."""
    return f'<div class="long">{table(head, rows)}</div>'


def bullets(lines: Sequence[str], most: int | None = None) -> str:
    """A list of lines of plain text; of more than ``most`` it says how many there are besides."""
    listed = "\n".join(f"<li>{_text(line)}</li>" for line in lines[:most])
    rest = 0 if most is None else len(lines) - most
    more = f"\n{paragraph(f'And {rest} more.')}" if rest > 0 else ""
    return f'<ul class="long">\n{listed}\n</ul>{more}'


def pictures_in_rows(pictures: Iterable[str], *, wide: bool = False) -> str:
    """Pictures beside each other, as many as the window has room for."""
    kind = "wide row" if wide else "row"
    return f'<div class="{kind}">\n' + "\n".join(pictures) + "\n</div>"


def preformatted(text: str) -> str:
    """A preformatted block."""
    return f"<pre>{html.escape(printable_lines(text))}</pre>"


def picture(source: Figure | Path, caption: str) -> str:
    """A figure or a PNG file, embedded in the page; the caption is also its alternative text."""
    size = ""
    if isinstance(source, Path):
        data = source.read_bytes()
        if source.is_symlink() or not data.startswith(_PNG):
            raise FileError(f"{source}: no PNG file, expected a figure of the run; delete it")
    else:
        data = png(source, dpi=_SCALE * _SHARPNESS)
        size = f' width="{source.get_figwidth() * _SCALE:.0f}"'
    words = _text(caption)
    base64_text = base64.b64encode(data).decode()
    return (
        f'<figure><img src="data:image/png;base64,{base64_text}"{size} alt="{words}">'
        f"<figcaption>{words}</figcaption></figure>"
    )

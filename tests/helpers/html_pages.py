"""HTML pages as a browser reads them: their rows, and whether their tags are closed."""

import re
from html.parser import HTMLParser

_VOID = {"img", "meta", "br", "hr", "input", "link"}


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: list[str] = []
        self.rows: list[list[str]] = []

    def handle_starttag(self, tag, attrs):
        assert len(attrs) == len(dict(attrs)), f"<{tag}>: an attribute twice"
        self.names += [value for name, value in attrs if name == "id"]
        if tag not in _VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_startendtag(self, tag, attrs):  # noqa: ARG002
        self.names += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        assert self.open[-1:] == [tag], f"</{tag}> at {self.getpos()}"
        self.open.pop()

    def handle_data(self, data):
        if self.rows and self.rows[-1] and {"td", "th"} & set(self.open[-3:]):
            self.rows[-1][-1] += data


def _read(page: str) -> _Reader:
    reader = _Reader()
    reader.feed(page)
    reader.close()
    return reader


def well_formed(page: str) -> None:
    """Expect every tag to be closed where it was opened, and names of elements to be unique."""
    reader = _read(page)
    assert not reader.open
    assert len(set(reader.names)) == len(reader.names)


def table_rows(page: str) -> list[list[str]]:
    """The texts of the cells of all rows of all tables."""
    return [[cell.strip() for cell in row] for row in _read(page).rows]


def row_of(*cells: object) -> str:
    """A row as a page has it: the first cell names the row."""
    first, *rest = cells
    return f'<tr><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in rest)}</tr>'


def lines_of(drawing: str, kind: str) -> list[list[tuple[float, float]]]:
    """The strips of the lines of a kind in a drawing, as points of its view box."""
    strips = []
    for data in re.findall(f'class="line {kind}" d="([^"]*)"', drawing):
        for strip in data.split("M")[1:]:
            numbers = [point.split(" ") for point in strip.split("L")]
            strips.append([(float(x), float(y)) for x, y in numbers])
    return strips


def marks_of(drawing: str, kind: str) -> list[tuple[float, float]]:
    """The middles of the marks of a kind in a drawing, as points of its view box."""
    (data,) = re.findall(f'class="(?:hit|marks) {kind}" d="([^"]*)"', drawing)
    return [(float(x), float(y)) for x, y in re.findall(r"M([-\d.]+) ([-\d.]+)", data)]

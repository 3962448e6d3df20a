"""The header of PLY files: elements, each with a number of rows and properties."""

from dataclasses import dataclass, field
from typing import NamedTuple

from deepring.data.scans.content import Buffer, ContentError

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = b"\nend_header"
_LONGEST_HEADER = 1 << 20  # bytes, to stop in files of other types


class Property(NamedTuple):
    """A number, or a list of numbers, in each row of an element."""

    name: str
    value: str  # NumPy type of the number, or of a list's items
    length: str | None  # NumPy type of a list's count; None for a number


@dataclass
class Element:
    """Rows of one kind."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)

    def __str__(self) -> str:
        return f"element {self.name} {self.rows}"


def read_header(content: Buffer) -> tuple[str, list[Element], int]:
    """The format, the elements, and the byte at which their rows begin.

    Raises ContentError for what is no header of a PLY file.
    """
    if content[: content.find(b"\n", 0, 80)].strip() != b"ply":
        raise ContentError("does not begin with the line 'ply'")
    start = content.find(_END, 0, _LONGEST_HEADER)
    if start < 0:
        raise ContentError("a header without end_header")
    end = start + len(_END)
    newline = b"\r\n" if content[end : end + 2] == b"\r\n" else b"\n"
    if content[end : end + len(newline)] not in (newline, b""):
        raise ContentError("a header without end_header on a line of its own")
    form, elements = "", list[Element]()
    for line in content[:start].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", kind, "1.0"] if not form:
                form = kind
            case ["element", name, rows] if rows.isascii() and rows.isdigit() and len(rows) < 19:
                elements.append(Element(name, int(rows)))
            case ["property", kind, name] if kind in _TYPES and elements:
                elements[-1].properties.append(Property(name, _TYPES[kind], None))
            case ["property", "list", count, kind, name] if (
                {count, kind} <= set(_TYPES) and elements and not count.startswith(("f", "d"))
            ):
                elements[-1].properties.append(Property(name, _TYPES[kind], _TYPES[count]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ContentError(f"the header line {line[:80]!r}")
    if form not in ORDERS:
        raise ContentError(f"format {form or 'missing'}, not one of {', '.join(ORDERS)}")
    return form, elements, min(end + len(newline), len(content))

"""Point clouds in PLY files: x, y, z of the element ``vertex``, ascii or binary.

A PLY file is a header of elements (name, number of rows, properties) followed by the rows of each
element. A property is a number, or a list: a count and that many numbers. Rows with lists may thus
differ in length, and have to be read one by one. Each row of an ascii body is one line.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct
from struct import error as StructError
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import ContentError, decoded
from deepring.data.scans.coordinates import coordinate_fields, expect_type, points_of
from deepring.data.scans.text_rows import text_rows
from deepring.data.session import Points

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = b"\nend_header"
_LONGEST_HEADER = 1 << 20  # bytes, to stop in files of other types


class _Property(NamedTuple):
    name: str
    value: str  # NumPy type of the number, or of a list's items
    length: str | None  # NumPy type of a list's count; None for a number


@dataclass
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)

    def __str__(self) -> str:
        return f"element {self.name} {self.rows}"


def read_ply(path: Path | str) -> Points:
    """The vertices (n, 3) float32 of a PLY file, in the file's order, with repetitions.

    x, y and z may be of any numeric type; other properties and elements are skipped. Vertices
    without a face are included.

    Raises BrokenScanError for another type of file, one without x, y and z, or one with fewer or
    more rows than its header says.
    """
    return decoded(path, _vertices, "PLY")


def _vertices(content: bytes) -> Points:
    form, elements, body = _header(content)
    vertices = [element for element in elements if element.name == "vertex"]
    if len(vertices) != 1:
        raise ContentError(f"{len(vertices) or 'no'} elements vertex in its header, not one")
    axes = coordinate_fields([p.name if p.length is None else "" for p in vertices[0].properties])
    if form == "ascii":
        return _ascii(elements, axes, body)
    at, points = 0, np.empty((0, 3), dtype=np.float32)
    for element in elements:
        if not element.rows or not element.properties:
            continue
        rows = _equal_rows(element, body, at, _ORDERS[form])
        if rows is not None:
            columns = [rows[str(k)] for k in axes] if element is vertices[0] else []
            at += rows.nbytes
        else:
            wanted = axes if element is vertices[0] else []
            columns, at = _rows_one_by_one(element, body, at, _ORDERS[form], wanted)
        if columns:
            points = points_of(columns)
    if at < len(body):
        raise _too_long(elements, f"{len(body) - at} bytes")
    return points


def _ascii(elements: list[_Element], axes: list[int], body: bytes) -> Points:
    lines = [line for line in body.splitlines() if line.strip()]
    at, points = 0, np.empty((0, 3), dtype=np.float32)
    for element in elements:
        if not element.properties:
            continue
        rows = lines[at : at + element.rows]
        if len(rows) < element.rows:
            raise _too_short(element, len(rows))
        at += element.rows
        numbers = _numbers(element, rows)
        if element.name == "vertex":
            kinds = [np.dtype(element.properties[k].value) for k in axes]
            points = points_of(
                [expect_type(numbers[:, k], kind) for k, kind in zip(axes, kinds, strict=True)]
            )
    if at < len(lines):
        raise _too_long(elements, f"{len(lines) - at} lines")
    return points


def _numbers(element: _Element, rows: list[bytes]) -> NDArray[np.float64]:
    """The numbers (rows, properties) of an element in text; NaN in place of lists."""
    single = [k for k, p in enumerate(element.properties) if p.length is None]
    numbers = np.full((len(rows), len(element.properties)), np.nan)
    if len(single) < len(element.properties):
        rows = [_without_lists(element, row) for row in rows]
    if single:
        numbers[:, single] = text_rows(b"\n".join(rows), len(single))
    return numbers


def _without_lists(element: _Element, row: bytes) -> bytes:
    """The numbers of a row that are not in lists."""
    words, kept = row.split(), []
    for p in element.properties:
        items = 1
        if p.length is not None:
            count, *words = words or [b""]
            if not (count.isdigit() and len(count) < 19):
                raise ContentError(f"a list of {count.decode('latin-1')[:40]!r} items in {element}")
            items = int(count)
        else:
            kept += words[:1]
        if items > len(words):
            raise ContentError(f"a row of {element} is cut short: {row[:80].decode('latin-1')!r}")
        words = words[items:]
    if words:
        raise ContentError(f"a row of {element} is too long: {row[:80].decode('latin-1')!r}")
    return b" ".join(kept)


def _header(content: bytes) -> tuple[str, list[_Element], bytes]:
    """The format, the elements, and the bytes of their rows."""
    if content[: content.find(b"\n", 0, 80)].strip() != b"ply":
        raise ContentError("does not begin with the line 'ply'")
    start = content.find(_END, 0, _LONGEST_HEADER)
    if start < 0:
        raise ContentError("a header without end_header")
    end = start + len(_END)
    newline = b"\r\n" if content[end : end + 2] == b"\r\n" else b"\n"
    if content[end : end + len(newline)] not in (newline, b""):
        raise ContentError("a header without end_header on a line of its own")
    body = content[end + len(newline) :]
    form, elements = "", list[_Element]()
    for line in content[:start].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", kind, "1.0"] if not form:
                form = kind
            case ["element", name, rows] if rows.isascii() and rows.isdigit() and len(rows) < 19:
                elements.append(_Element(name, int(rows)))
            case ["property", kind, name] if kind in _TYPES and elements:
                elements[-1].properties.append(_Property(name, _TYPES[kind], None))
            case ["property", "list", count, kind, name] if (
                {count, kind} <= set(_TYPES) and elements and not count.startswith(("f", "d"))
            ):
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ContentError(f"the header line {line[:80]!r}")
    if form not in _ORDERS:
        raise ContentError(f"format {form or 'missing'}, not one of {', '.join(_ORDERS)}")
    return form, elements, body


def _too_short(element: _Element, rows: int) -> ContentError:
    return ContentError(f"ends within {element} of its header, after {rows} rows")


def _too_long(elements: list[_Element], more: str) -> ContentError:
    return ContentError(f"{more} more than its header says ({', '.join(map(str, elements))})")


def _equal_rows(element: _Element, body: bytes, at: int, order: str) -> NDArray[Any] | None:
    """The rows (n,) of an element that begins at byte ``at``, with property k in field "k".

    None if lists differ in length, or a row is missing in an element with lists.
    """
    kind = _first_row(element, body, at, order)
    counts = [name for name in kind.names or () if name.startswith("#")]
    if at + element.rows * kind.itemsize > len(body):
        if counts:
            return None
        raise _too_short(element, (len(body) - at) // kind.itemsize)
    rows: NDArray[Any] = np.frombuffer(body, kind, element.rows, at)
    return rows if all((rows[name] == rows[name][0]).all() for name in counts) else None


def _first_row(element: _Element, body: bytes, at: int, order: str) -> np.dtype:
    """The type of the row at byte ``at``, with the length k of a list in field "#k"."""
    fields: list[tuple[Any, ...]] = []
    size = 0
    for k, p in enumerate(element.properties):
        items: tuple[int, ...] = ()
        if p.length is not None:
            fields.append((f"#{k}", order + p.length))
            items = (_list_length(element, body, at + size, order + p.length),)
            size += np.dtype(p.length).itemsize
        fields.append((f"{k}", order + p.value, items))
        size += np.dtype(p.value).itemsize * math.prod(items)
        if at + size > len(body):
            raise _too_short(element, 0)
    return np.dtype(fields)


def _list_length(element: _Element, body: bytes, at: int, kind: str) -> int:
    if at + np.dtype(kind).itemsize > len(body):
        raise _too_short(element, 0)
    items = int(np.frombuffer(body, kind, 1, at)[0])
    if items < 0:
        raise ContentError(f"a list of {items} items in {element}")
    return items


def _rows_one_by_one(
    element: _Element, body: bytes, at: int, order: str, axes: list[int]
) -> tuple[list[NDArray[np.float64]], int]:
    """The columns of the properties ``axes`` of rows of several lengths, and the rows' end."""
    columns: dict[int, list[float]] = {k: [] for k in axes}
    steps = [
        (k, Struct(order + np.dtype(p.length or p.value).char), np.dtype(p.value).itemsize, p)
        for k, p in enumerate(element.properties)
    ]
    row = 0
    try:
        for row in range(element.rows):
            for k, number, size, p in steps:
                (value,) = number.unpack_from(body, at)
                at += number.size
                if p.length is None:
                    if k in columns:
                        columns[k].append(value)
                    continue
                if value < 0:
                    raise ContentError(f"a list of {value} items in {element}")
                at += value * size
            if at > len(body):
                raise _too_short(element, row)
    except StructError:
        raise _too_short(element, row) from None
    return [np.array(columns[k], dtype=np.float64) for k in axes], at

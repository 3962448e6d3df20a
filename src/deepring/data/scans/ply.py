"""Point clouds in PLY files: x, y, z of the element ``vertex``, ascii or binary.

A PLY file is a header of elements (name, number of rows, properties) followed by the rows of each
element. A property is a number, or a list: a count and that many numbers. Rows with lists may thus
differ in length, and have to be read one by one. An ascii body is converted to a binary one of
float64 values, counts included.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.session import Points
from deepring.errors import BrokenScanError

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
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise BrokenScanError(f"scan {path}: cannot be read ({error.strerror})") from error
    try:
        return _vertices(content)
    except _PlyError as error:
        raise BrokenScanError(f"scan {path}: {error}; expected a complete PLY file") from None


class _PlyError(Exception):
    """A defect of a file; `read_ply` adds the file's name."""


def _vertices(content: bytes) -> Points:
    order, elements, body = _header(content)
    at, points = 0, None
    for element in elements:
        rows, at = _rows(element, body, at, order)
        if element.name == "vertex":
            points = _coordinates(element, rows)
    if at < len(body):
        names = ", ".join(map(str, elements))
        raise _PlyError(f"{len(body) - at} bytes more than its header says ({names})")
    if points is None:
        raise _PlyError("no element vertex in its header")
    return points


def _header(content: bytes) -> tuple[str, list[_Element], bytes]:
    """The byte order, the elements, and the bytes of their rows."""
    if not content.startswith(b"ply"):
        raise _PlyError("does not begin with the line 'ply'")
    start = content.find(_END, 0, _LONGEST_HEADER)
    if start < 0:
        raise _PlyError("a header without end_header")
    end = start + len(_END)
    newline = b"\r\n" if content[end : end + 2] == b"\r\n" else b"\n"
    if content[end : end + len(newline)] not in (newline, b""):
        raise _PlyError("a header without end_header on a line of its own")
    body = content[end + len(newline) :]
    form, elements = "", list[_Element]()
    for line in content[:start].decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", form, _]:
                pass
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
                raise _PlyError(f"the header line {line[:80]!r}")
    if form not in _ORDERS:
        raise _PlyError(f"format {form or 'missing'}, not one of {', '.join(_ORDERS)}")
    if form == "ascii":
        body = _numbers(body)
        for element in elements:
            element.properties = [
                p._replace(value="f8", length=p.length and "f8") for p in element.properties
            ]
    return _ORDERS[form], elements, body


def _numbers(text: bytes) -> bytes:
    """The numbers of an ascii body, as little-endian float64."""
    try:
        return np.array(text.split(), dtype="<f8").tobytes()
    except ValueError as error:
        raise _PlyError("an ascii body with values other than numbers") from error


def _rows(element: _Element, body: bytes, at: int, order: str) -> tuple[list[NDArray[Any]], int]:
    """The rows of an element that begins at byte ``at``, in one or more arrays, and its end."""
    if not element.rows or not element.properties:
        return [], at
    kind = _row_type(element, body, at, order)
    end = at + element.rows * kind.itemsize
    counts = [name for name in kind.names or () if name.startswith("#")]
    if end <= len(body):
        array = np.frombuffer(body, kind, element.rows, at)
        if all((array[name] == array[name][0]).all() for name in counts):
            return [array], end
    elif not counts:
        row = (len(body) - at) // kind.itemsize
        raise _PlyError(f"ends within {element} of its header, after {row} rows")
    rows: list[NDArray[Any]] = []  # lists of several lengths
    for row in range(element.rows):
        kind = _row_type(element, body, at, order)
        if at + kind.itemsize > len(body):
            raise _PlyError(f"ends within {element} of its header, after {row} rows")
        rows.append(np.frombuffer(body, kind, 1, at))
        at += kind.itemsize
    return rows, at


def _row_type(element: _Element, body: bytes, at: int, order: str) -> np.dtype:
    """The type of the row at byte ``at``, with the lengths of its lists."""
    fields: list[tuple[Any, ...]] = []
    size = 0
    for k, (_, value, count) in enumerate(element.properties):
        item = np.dtype(order + value)
        if count is None:
            fields.append((f"{k}", item))
            size += item.itemsize
            continue
        length = np.dtype(order + count)
        if at + size + length.itemsize > len(body):
            raise _PlyError(f"ends within {element} of its header")
        items = float(np.frombuffer(body, length, 1, at + size)[0])
        if not (items >= 0 and items.is_integer()):
            raise _PlyError(f"a list of {items:g} items in {element} of its header")
        size += length.itemsize + int(items) * item.itemsize
        if at + size > len(body):
            raise _PlyError(f"ends within {element} of its header")
        fields += [(f"#{k}", length), (f"{k}", item, (int(items),))]
    return np.dtype(fields)


def _coordinates(element: _Element, rows: list[NDArray[Any]]) -> Points:
    numbers = {p.name: str(k) for k, p in enumerate(element.properties) if p.length is None}
    if not {"x", "y", "z"} <= set(numbers):
        names = ", ".join(p.name for p in element.properties)
        raise _PlyError(f"{element} of its header has {names or 'no properties'}, not x, y and z")
    if not rows:
        return np.empty((0, 3), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32 becomes infinite
        columns = [
            np.concatenate([part[numbers[name]] for part in rows]).astype(np.float32)
            for name in "xyz"
        ]
    return np.stack(columns, axis=1)

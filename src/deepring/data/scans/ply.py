"""Point clouds in PLY files: x, y, z of the element ``vertex``, ascii or binary.

A PLY file is a header of elements (name, number of rows, properties) followed by the rows of each
element. A property is a number, or a list: a count and that many numbers. Rows with lists may thus
differ in length, and have to be read one by one. Each row of an ascii body is one line.
"""

import math
from pathlib import Path
from struct import Struct
from struct import error as StructError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import Buffer, ContentError, decoded
from deepring.data.scans.coordinates import coordinate_fields, expect_type, points_of
from deepring.data.scans.ply_header import ORDERS, Element, read_header
from deepring.data.scans.text_rows import text_rows
from deepring.data.session import Points


def read_ply(path: Path | str) -> Points:
    """The vertices (n, 3) float32 of a PLY file, in the file's order, with repetitions.

    x, y and z may be of any numeric type; other properties and elements are skipped. Vertices
    without a face are included.

    Raises BrokenScanError for another type of file, one without x, y and z, or one with fewer or
    more rows than its header says.
    """
    return decoded(path, lambda content: points_of(columns_of(content)), "PLY")


def columns_of(content: Buffer) -> list[NDArray[Any]]:
    """x, y and z (n,) of the content of a PLY file, in its types; views of it where it is binary.

    Raises ContentError as `read_ply` raises BrokenScanError.
    """
    form, elements, at = read_header(content)
    axes = vertex_axes(elements)
    if form == "ascii":
        return _ascii(elements, axes, content[at:])
    found: list[NDArray[Any]] = [np.empty(0, dtype=np.float32)] * 3
    for element in elements:
        if not element.rows or not element.properties:
            continue
        rows = _equal_rows(element, content, at, ORDERS[form])
        if rows is not None:
            columns = [rows[str(k)] for k in axes] if element.name == "vertex" else []
            at += rows.nbytes
        else:
            wanted = axes if element.name == "vertex" else []
            columns, at = _rows_one_by_one(element, content, at, ORDERS[form], wanted)
        found = columns or found
    if at < len(content):
        raise too_long(elements, f"{len(content) - at} bytes")
    return found


def vertex_axes(elements: list[Element]) -> list[int]:
    """The properties x, y and z of the vertices. Raises ContentError for a header without them."""
    vertices = [element for element in elements if element.name == "vertex"]
    if len(vertices) != 1:
        raise ContentError(f"{len(vertices) or 'no'} elements vertex in its header, not one")
    return coordinate_fields([p.name if p.length is None else "" for p in vertices[0].properties])


def _ascii(elements: list[Element], axes: list[int], body: bytes) -> list[NDArray[Any]]:
    lines = [line for line in body.splitlines() if line.strip()]
    at, found = 0, [np.empty(0)] * 3
    for element in elements:
        if not element.properties:
            continue
        rows = lines[at : at + element.rows]
        if len(rows) < element.rows:
            raise too_short(element, len(rows))
        at += element.rows
        coordinates = text_columns(element, axes if element.name == "vertex" else [], rows)
        found = coordinates or found
    if at < len(lines):
        raise too_long(elements, f"{len(lines) - at} lines")
    return found


def text_columns(element: Element, axes: list[int], rows: list[bytes]) -> list[NDArray[np.float64]]:
    """The properties ``axes`` (rows,) of the lines of an element; all others are checked too."""
    numbers = _numbers(element, rows)
    kinds = [np.dtype(element.properties[k].value) for k in axes]
    return [expect_type(numbers[:, k], kind) for k, kind in zip(axes, kinds, strict=True)]


def _numbers(element: Element, rows: list[bytes]) -> NDArray[np.float64]:
    """The numbers (rows, properties) of an element in text; NaN in place of lists."""
    single = [k for k, p in enumerate(element.properties) if p.length is None]
    numbers = np.full((len(rows), len(element.properties)), np.nan)
    if len(single) < len(element.properties):
        rows = [_without_lists(element, row) for row in rows]
    if single:
        numbers[:, single] = text_rows(b"\n".join(rows), len(single))
    return numbers


def _without_lists(element: Element, row: bytes) -> bytes:
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


def too_short(element: Element, rows: int) -> ContentError:
    """Of a file that ends after some rows of an element."""
    return ContentError(f"ends within {element} of its header, after {rows} rows")


def too_long(elements: list[Element], more: str) -> ContentError:
    """Of a file that goes on after the last element."""
    return ContentError(f"{more} more than its header says ({', '.join(map(str, elements))})")


def _equal_rows(element: Element, body: Buffer, at: int, order: str) -> NDArray[Any] | None:
    """The rows (n,) of an element that begins at byte ``at``, with property k in field "k".

    None if lists differ in length, or a row is missing in an element with lists.
    """
    kind = _first_row(element, body, at, order)
    counts = [name for name in kind.names or () if name.startswith("#")]
    if at + element.rows * kind.itemsize > len(body):
        if counts:
            return None
        raise too_short(element, (len(body) - at) // kind.itemsize)
    rows: NDArray[Any] = np.frombuffer(body, kind, element.rows, at)
    return rows if all((rows[name] == rows[name][0]).all() for name in counts) else None


def _first_row(element: Element, body: Buffer, at: int, order: str) -> np.dtype:
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
            raise too_short(element, 0)
    return np.dtype(fields)


def _list_length(element: Element, body: Buffer, at: int, kind: str) -> int:
    if at + np.dtype(kind).itemsize > len(body):
        raise too_short(element, 0)
    items = int(np.frombuffer(body, kind, 1, at)[0])
    if items < 0:
        raise ContentError(f"a list of {items} items in {element}")
    return items


def _rows_one_by_one(
    element: Element, body: Buffer, at: int, order: str, axes: list[int]
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
                raise too_short(element, row)
    except StructError:
        raise too_short(element, row) from None
    return [np.array(columns[k], dtype=np.float64) for k in axes], at

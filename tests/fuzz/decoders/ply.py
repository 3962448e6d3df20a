"""PLY: a header of elements and properties, and their rows as text or in either byte order."""

import re
import struct
from collections.abc import Callable
from typing import Any

from fuzz.decoders.pcd import _number as number
from fuzz.decoders.points import Points, lowered, returns
from fuzz.files import UndecodableError

_TYPES = {
    **{"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I"},
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"},
    **{"float": "f", "double": "d", "float32": "f", "float64": "d"},
}
_MOST = 1_000_000  # rows without bytes, of an element without properties


def decode(content: bytes) -> Points:
    """The vertices of a file."""
    form, elements, body = _header(content)
    read, left = _reader(form, body)
    points = None
    for name, rows, properties in elements:
        names = lowered([label if count is None else "" for label, count, _ in properties])
        wanted = name == "vertex"
        if wanted and any(names.count(axis) != 1 for axis in "xyz"):
            raise UndecodableError("no x, y and z")
        found = []
        for _ in range(rows if properties else 0):
            row = {}
            for label, (_, count, kind) in zip(names, properties, strict=True):
                if count is None:
                    row[label] = read(kind)
                    continue
                length = read(count)
                if length < 0 or length != int(length):
                    raise UndecodableError("a list of a length that is none")
                for _ in range(int(length)):
                    read(kind)
            if wanted:
                found.append([row["x"], row["y"], row["z"]])
        if wanted:
            if points is not None:
                raise UndecodableError("two elements vertex")
            points = found
    if points is None:
        raise UndecodableError("no element vertex")
    if left():
        raise UndecodableError("more bytes than the header says")
    return returns(points)


def _header(content: bytes) -> tuple[str, list[tuple[str, int, list[Any]]], bytes]:
    match = re.search(rb"\nend_header[ \t]*(\r\n|\n|\r|$)", content)
    if not re.match(rb"ply[ \t]*(\r\n|\n|\r)", content) or match is None:
        raise UndecodableError("no header")
    text, body = content[: match.start()].decode("latin-1"), content[match.end() :]
    form, elements = "", []
    for line in re.split(r"\r\n|\n|\r", text)[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and not form:
            form = words[1]
        elif words[0] == "element" and len(words) == 3 and re.fullmatch("[0-9]{1,18}", words[2]):
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property" and len(words) == 3 and words[1] in _TYPES and elements:
            elements[-1][2].append((words[2], None, _TYPES[words[1]]))
        elif words[:2] == ["property", "list"] and len(words) == 5 and elements:
            count, kind = words[2:4]
            if count not in _TYPES or kind not in _TYPES or _TYPES[count] in "fd":
                raise UndecodableError("a list of an unknown type")
            elements[-1][2].append((words[4], _TYPES[count], _TYPES[kind]))
        else:
            raise UndecodableError(f"a header line {line[:30]!r}")
    if form not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise UndecodableError("an unknown format")
    return form, elements, body


def _reader(form: str, body: bytes) -> tuple[Callable[[str], float], Callable[[], bool]]:
    """A function that reads the next value, and one that tells whether anything is left."""
    at = 0
    words = body.split() if form == "ascii" else []
    order = ">" if "big" in form else "<"

    def read(kind: str) -> float:
        nonlocal at
        if form == "ascii":
            if at >= len(words):
                raise UndecodableError("fewer values than the header says")
            at += 1
            return number(words[at - 1])
        layout = order + kind
        end = at + struct.calcsize(layout)
        if end > len(body):
            raise UndecodableError("fewer bytes than the header says")
        (value,) = struct.unpack_from(layout, body, at)
        at = end
        return float(value)

    return read, lambda: at < (len(words) if form == "ascii" else len(body))

"""PCD, versions .5 to .7: a header of lines, and points as text, records, or compressed columns."""

import math
import re
import struct

from fuzz.decoders.lzf import decompress
from fuzz.decoders.points import Points, lowered, returns
from fuzz.files import UndecidedError, UndecodableError

_KINDS = {
    **{("F", 4): "f", ("F", 8): "d", ("I", 1): "b", ("I", 2): "h", ("I", 4): "i", ("I", 8): "q"},
    **{("U", 1): "B", ("U", 2): "H", ("U", 4): "I", ("U", 8): "Q"},
}
_KEYS = (
    "VERSION",
    "FIELDS",
    "SIZE",
    "TYPE",
    "COUNT",
    "WIDTH",
    "HEIGHT",
    "VIEWPOINT",
    "POINTS",
    "DATA",
)


def decode(content: bytes) -> Points:
    """The points of a file."""
    header, body = _header(content)
    fields = lowered(header["FIELDS"])
    sizes, counts = _numbers(header, "SIZE"), _numbers(header, "COUNT", [1] * len(fields))
    kinds = [kind.upper() for kind in header["TYPE"]]
    if not len(fields) == len(sizes) == len(counts) == len(kinds):
        raise UndecodableError("a header whose lines disagree")
    named = [name for name in fields if name in ("x", "y", "z")]
    if sorted(named) != ["x", "y", "z"]:
        raise UndecodableError("no x, y and z")
    letters = []
    for kind, size in zip(kinds, sizes, strict=True):
        if (kind, size) not in _KINDS:
            raise UndecodableError(f"a field of type {kind} {size}")
        letters.append(_KINDS[kind, size])
    if any(counts[fields.index(name)] != 1 for name in "xyz"):
        raise UndecidedError  # several values of a coordinate
    points = _count(header)
    form = header["DATA"][0].lower() if header["DATA"] else ""
    reader = {"ascii": _text, "binary": _binary, "binary_compressed": _columns}.get(form)
    if reader is None:
        raise UndecodableError("data of another form")
    rows = reader(body, letters, counts, points)
    starts = [sum(counts[:k]) for k in range(len(counts))]
    at = [starts[fields.index(name)] for name in "xyz"]
    return returns([row[k] for k in at] for row in rows)


def _header(content: bytes) -> tuple[dict[str, list[str]], bytes]:
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = content.find(b"\n", at)
        if end < 0 or end > 100_000:
            raise UndecodableError("no DATA line")
        line = content[at:end].decode("latin-1").strip()
        at = end + 1
        if line.startswith("#") or not line:
            continue
        key, *values = line.split()
        key = "FIELDS" if key.upper() == "COLUMNS" else key.upper()
        if key not in _KEYS:
            raise UndecodableError(f"a header line {key[:20]!r}")
        if key in header:
            raise UndecodableError("a header line twice")
        header[key] = values
    for key in ("FIELDS", "SIZE", "TYPE"):
        if key not in header and key == "SIZE" and header["DATA"][:1] == ["ascii"]:
            raise UndecidedError  # text has no sizes
        if key not in header:
            raise UndecodableError(f"no {key} line")
    return header, content[at:]


def _numbers(header: dict[str, list[str]], key: str, default: list[int] | None = None) -> list[int]:
    if key not in header and default is not None:
        return default
    if not all(re.fullmatch(r"\+?[0-9]{1,18}", text) for text in header[key]):
        raise UndecodableError(f"{key} of other than numbers")
    return [int(text) for text in header[key]]


def _count(header: dict[str, list[str]]) -> int:
    """The number of points, from POINTS or WIDTH x HEIGHT, which agree where both are stated."""
    stated = {}
    for key in ("POINTS", "WIDTH", "HEIGHT"):
        if key in header:
            numbers = _numbers(header, key)
            if len(numbers) != 1:
                raise UndecodableError(f"{key} of {len(numbers)} numbers")
            stated[key] = numbers[0]
    if "POINTS" in stated:
        points = stated["POINTS"]
        if "WIDTH" in stated and stated["WIDTH"] * stated.get("HEIGHT", 1) != points:
            raise UndecodableError("POINTS other than WIDTH x HEIGHT")
        return points
    if "WIDTH" in stated:
        return stated["WIDTH"] * stated.get("HEIGHT", 1)
    raise UndecodableError("no number of points")


def _text(body: bytes, letters: list[str], counts: list[int], points: int) -> list[list[float]]:
    lines = [line.split() for line in body.split(b"\n") if line.strip()]
    if len(lines) != points:
        raise UndecodableError(f"{len(lines)} rows, not {points}")
    kinds = [letter for letter, count in zip(letters, counts, strict=True) for _ in range(count)]
    rows = []
    for line in lines:
        if len(line) != len(kinds):
            raise UndecodableError("a row of another length")
        rows.append([_number(text) for text in line])
    return rows


def _number(text: bytes) -> float:
    if re.fullmatch(rb"[-+]?nan(\(\w*\))?", text, re.IGNORECASE):
        return math.nan
    if re.fullmatch(rb"[-+]?inf(inity)?", text, re.IGNORECASE):
        return -math.inf if text.startswith(b"-") else math.inf
    if not re.fullmatch(rb"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", text):
        raise UndecodableError("a value that is no number")
    return float(text)


def _binary(body: bytes, letters: list[str], counts: list[int], points: int) -> list[list[float]]:
    layout = "<" + "".join(f"{n}{letter}" for letter, n in zip(letters, counts, strict=True) if n)
    size = struct.calcsize(layout)
    if not size or len(body) != points * size:
        raise UndecodableError(f"{len(body)} bytes for {points} points of {size}")
    return [list(row) for row in struct.iter_unpack(layout, body)]


def _columns(body: bytes, letters: list[str], counts: list[int], points: int) -> list[list[float]]:
    if len(body) < 8:
        raise UndecodableError("no sizes before the compressed points")
    packed, whole = struct.unpack_from("<II", body)
    size = struct.calcsize("<" + "".join(letters))
    size = sum(struct.calcsize("<" + v) * n for v, n in zip(letters, counts, strict=True))
    if len(body) != 8 + packed or whole != points * size:
        raise UndecodableError("sizes other than the header's")
    data = decompress(body[8:], whole)
    at, columns = 0, []
    for letter, count in zip(letters, counts, strict=True):
        layout = f"<{count * points}{letter}"
        values = struct.unpack_from(layout, data, at)
        at += struct.calcsize(layout)
        columns += [values[k::count] for k in range(count)]
    return [list(row) for row in zip(*columns, strict=True)] if columns else []

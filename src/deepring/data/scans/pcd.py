"""Point clouds in PCD files, versions 0.5 to 0.7: ascii, binary and binary_compressed.

The format is that of the Point Cloud Library: a header of lines that begin with a keyword, then the
points. Files of other sizes than their header says are refused. VIEWPOINT is not applied: points
are in the frame that they are stored in.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import LARGEST, ContentError, decoded
from deepring.data.scans.coordinates import coordinate_fields, expect_type, points_of
from deepring.data.scans.text_rows import text_rows
from deepring.data.session import Points

_TYPES = {
    **{("F", 4): "<f4", ("F", 8): "<f8"},
    **{("I", size): f"<i{size}" for size in (1, 2, 4, 8)},
    **{("U", size): f"<u{size}" for size in (1, 2, 4, 8)},
}
_KEYWORDS = (
    *("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS"),
    "DATA",
)
_UNUSED = ("VERSION", "VIEWPOINT")
_PADDING = "_"
_LONGEST_HEADER = 1 << 20  # bytes, to stop in files of other types
#: Most that LZF compresses: 264 bytes to 3.
_LZF_RATIO = 88
#: Versions of the library before 1.8 made binary files longer than their points by a page of
#: memory less the header, all zeros.
_PAGES = (1 << 12, 1 << 13, 1 << 14, 1 << 16)


@dataclass(frozen=True)
class _Field:
    name: str
    type: np.dtype
    count: int

    @property
    def size(self) -> int:
        """Bytes of one point."""
        return self.type.itemsize * self.count


@dataclass(frozen=True)
class _Header:
    fields: tuple[_Field, ...]
    points: int
    end: int  # byte at which the points begin

    @property
    def record(self) -> int:
        """Bytes of one point."""
        return sum(field.size for field in self.fields)


def read_pcd(path: Path | str) -> Points:
    """The points (n, 3) float32 of a PCD file, row by row, with missing returns.

    x, y and z may be of any type; other fields are skipped. Raises BrokenScanError for another type
    of file, one without x, y and z, and one that has fewer or more points than its header says.
    """
    return decoded(path, _points, "PCD")


def _points(content: bytes) -> Points:
    header, data = _header(content)
    axes = coordinate_fields([field.name for field in header.fields])
    for k in axes:
        if header.fields[k].count != 1:
            field = header.fields[k]
            raise ContentError(f"COUNT {field.count} of field {field.name}, not 1")
    return _BODIES[data](header, axes, content)


def _header(content: bytes) -> tuple[_Header, str]:
    """The header, and the name of the encoding of the points."""
    values: dict[str, list[str]] = {}
    end = 0
    while "DATA" not in values:
        start, end = end, content.find(b"\n", end, _LONGEST_HEADER) + 1
        if not end:
            raise ContentError("a header without a line DATA")
        line = content[start : end - 1].decode("latin-1").strip()
        if not line or line.startswith("#"):
            continue
        keyword, *words = line.split()
        keyword = "FIELDS" if keyword == "COLUMNS" else keyword  # its name in old files
        known = keyword in _KEYWORDS and (words or keyword in _UNUSED)
        if not known or not line.isascii():
            raise ContentError(f"the header line {line[:80]!r}")
        if keyword in values:
            raise ContentError(f"two header lines {keyword}")
        values[keyword] = words
    data = " ".join(values["DATA"]).lower()
    if data not in _BODIES:
        raise ContentError(f"DATA {data[:80]}, not {', '.join(_BODIES)}")
    return _Header(_fields(values), _count_of_points(values), end), data


def _fields(values: dict[str, list[str]]) -> tuple[_Field, ...]:
    if "FIELDS" not in values:
        raise ContentError("a header without a line FIELDS")
    names = values["FIELDS"]
    # Old files leave out what the library takes as its own default.
    kinds = values.get("TYPE", ["F"] * len(names))
    sizes = _numbers(values, "SIZE", [4] * len(names))
    counts = _numbers(values, "COUNT", [1] * len(names))
    for keyword, list_ in (("TYPE", kinds), ("SIZE", sizes), ("COUNT", counts)):
        if len(list_) != len(names):
            raise ContentError(f"{len(list_)} values of {keyword} for {len(names)} FIELDS")
    fields = []
    for name, kind, size, count in zip(names, kinds, sizes, counts, strict=True):
        if (kind, size) not in _TYPES:
            raise ContentError(f"TYPE {kind[:8]} with SIZE {size} of field {name[:40]}")
        if not count:
            raise ContentError(f"COUNT 0 of field {name[:40]}")
        fields.append(_Field(name, np.dtype(_TYPES[kind, size]), count))
    if (record := sum(field.size for field in fields)) > LARGEST:
        raise ContentError(f"{record} bytes of one point")
    return tuple(fields)


def _count_of_points(values: dict[str, list[str]]) -> int:
    width, height, points = (
        _numbers(values, keyword, [-1]) for keyword in ("WIDTH", "HEIGHT", "POINTS")
    )
    if any(len(numbers) != 1 for numbers in (width, height, points)):
        raise ContentError("several values of WIDTH, HEIGHT or POINTS")
    if width[0] < 0:
        if height[0] >= 0 or points[0] < 0:
            raise ContentError("a header without a line WIDTH")
        return points[0]
    count = width[0] * (1 if height[0] < 0 else height[0])
    if points[0] not in (count, -1):
        raise ContentError(
            f"WIDTH {width[0]} and HEIGHT {height[0]} in its header, but POINTS {points[0]}"
        )
    return count


def _numbers(values: dict[str, list[str]], keyword: str, default: list[int]) -> list[int]:
    """The whole numbers of a header line."""
    words = values.get(keyword)
    if words is None:
        return default
    if not all(word.isascii() and word.isdigit() and len(word) < 19 for word in words):
        raise ContentError(f"the header line {keyword} {' '.join(words)[:80]!r}")
    return [int(word) for word in words]


def _ascii(header: _Header, axes: list[int], content: bytes) -> Points:
    counts = [field.count for field in header.fields]
    rows = text_rows(content[header.end :], sum(counts))
    _expect_points(header, len(rows), "lines")
    return points_of([expect_type(rows[:, sum(counts[:k])], header.fields[k].type) for k in axes])


def _binary(header: _Header, axes: list[int], content: bytes) -> Points:
    size = len(content) - header.end
    expected = header.points * header.record
    padded = len(content) - expected in _PAGES and not any(content[header.end + expected :])
    if size != expected and not padded:
        if size < expected:
            _expect_points(header, size // header.record, "records")
        raise ContentError(
            f"{size - expected} bytes more than {header.points} points of {header.record} bytes"
        )
    starts = [header.end + sum(field.size for field in header.fields[:k]) for k in axes]
    return _strided(header, axes, np.frombuffer(content, np.uint8), starts, header.record)


def _compressed(header: _Header, axes: list[int], content: bytes) -> Points:
    body = memoryview(content)[header.end :]
    if len(body) < 8:
        raise ContentError(f"{len(body)} bytes after its header")
    packed, size = struct.unpack_from("<II", body)
    rest = body[8:]
    padded = len(content) - 8 - packed in _PAGES and not any(rest[packed:])
    if packed != len(rest) and not padded:
        raise ContentError(f"{len(rest)} bytes of compressed points, not {packed} as it says")
    # The library leaves fields of padding out, other programs do not.
    fields = [field for field in header.fields if field.name != _PADDING]
    if size != header.points * sum(field.size for field in fields):
        fields = list(header.fields)
    expected = header.points * sum(field.size for field in fields)
    if size != expected:
        raise ContentError(
            f"{size} bytes of points, not {expected}: {header.points} of {header.record} bytes"
        )
    if size > min(packed * _LZF_RATIO, LARGEST):
        raise ContentError(f"{size} bytes of points in {packed} bytes, more than can be compressed")
    out = np.empty(size, dtype=np.uint8)
    if size or packed:
        from deepring.data.scans._lzf_kernel import unpack

        if not unpack(np.frombuffer(rest[:packed], np.uint8), out):
            raise ContentError("its compressed points are damaged")
    wanted = [header.fields[k] for k in axes]
    starts = [
        header.points * sum(field.size for field in fields[: fields.index(w)]) for w in wanted
    ]
    return _strided(header, axes, out, starts, None)


def _strided(
    header: _Header, axes: list[int], data: NDArray[np.uint8], starts: list[int], step: int | None
) -> Points:
    """Points from the bytes where each coordinate begins, ``step`` bytes apart, or packed."""
    if not header.points:
        return np.empty((0, 3), dtype=np.float32)
    columns: list[NDArray[Any]] = []
    for k, start in zip(axes, starts, strict=True):
        kind = header.fields[k].type
        stride = kind.itemsize if step is None else step
        columns.append(np.ndarray((header.points,), kind, data, start, (stride,)))
    return points_of(columns)


def _expect_points(header: _Header, found: int, what: str) -> None:
    if found != header.points:
        raise ContentError(f"{found} {what} for {header.points} points in its header")


_BODIES: dict[str, Callable[[_Header, list[int], bytes], Points]] = {
    "ascii": _ascii,
    "binary": _binary,
    "binary_compressed": _compressed,
}

"""Point clouds in PCD files, versions 0.5 to 0.7: ascii, binary and binary_compressed.

The format is that of the Point Cloud Library: a header of lines that begin with a keyword, then the
points. Files of other sizes than their header says are refused. VIEWPOINT is not applied: points
are in the frame that they are stored in.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import LARGEST, Buffer, ContentError, decoded
from deepring.data.scans.coordinates import coordinate_fields, expect_type, points_of
from deepring.data.scans.pcd_header import PADDING, PcdHeader, read_header
from deepring.data.scans.text_rows import text_rows
from deepring.data.session import Points

#: Most that LZF compresses: 264 bytes to 3.
_LZF_RATIO = 88
#: Versions of the library before 1.8 made binary files longer than their points by a page of
#: memory less the header, all zeros.
_PAGES = (1 << 12, 1 << 13, 1 << 14, 1 << 16)


def read_pcd(path: Path | str) -> Points:
    """The points (n, 3) float32 of a PCD file, row by row, with missing returns.

    x, y and z may be of any type; other fields are skipped. Raises BrokenScanError for another type
    of file, one without x, y and z, and one that has fewer or more points than its header says.
    """
    return decoded(path, lambda content: points_of(columns_of(content)), "PCD")


def columns_of(content: Buffer) -> list[NDArray[Any]]:
    """x, y and z (n,) of the content of a PCD file, in its types; views of it where it is binary.

    Raises ContentError as `read_pcd` raises BrokenScanError.
    """
    header = read_header(content)
    return _BODIES[header.data](header, coordinate_axes(header), content)


def coordinate_axes(header: PcdHeader) -> list[int]:
    """The fields x, y and z of a header. Raises ContentError unless each is one number."""
    axes = coordinate_fields([field.name for field in header.fields])
    for k in axes:
        if header.fields[k].count != 1:
            field = header.fields[k]
            raise ContentError(f"COUNT {field.count} of field {field.name}, not 1")
    return axes


def _ascii(header: PcdHeader, axes: list[int], content: Buffer) -> list[NDArray[Any]]:
    counts = [field.count for field in header.fields]
    rows = text_rows(content[header.end :], sum(counts))
    expect_points(header, len(rows), "lines")
    return [expect_type(rows[:, sum(counts[:k])], header.fields[k].type) for k in axes]


def _binary(header: PcdHeader, axes: list[int], content: Buffer) -> list[NDArray[Any]]:
    size = len(content) - header.end
    expected = header.points * header.record
    padded = len(content) - expected in _PAGES and not any(content[header.end + expected :])
    if size != expected and not padded:
        if size < expected:
            expect_points(header, size // header.record, "records")
        raise ContentError(
            f"{size - expected} bytes more than {header.points} points of {header.record} bytes"
        )
    starts = [header.end + sum(field.size for field in header.fields[:k]) for k in axes]
    return _strided(header, axes, np.frombuffer(content, np.uint8), starts, header.record)


def _compressed(header: PcdHeader, axes: list[int], content: Buffer) -> list[NDArray[Any]]:
    body = memoryview(content)[header.end :]
    if len(body) < 8:
        raise ContentError(f"{len(body)} bytes after its header")
    packed, size = struct.unpack_from("<II", body)
    rest = body[8:]
    padded = len(content) - 8 - packed in _PAGES and not any(rest[packed:])
    if packed != len(rest) and not padded:
        raise ContentError(f"{len(rest)} bytes of compressed points, not {packed} as it says")
    # The library leaves fields of padding out, other programs do not.
    fields = [field for field in header.fields if field.name != PADDING]
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
    header: PcdHeader, axes: list[int], data: NDArray[np.uint8], starts: list[int], step: int | None
) -> list[NDArray[Any]]:
    """Coordinates from the bytes where each coordinate begins, ``step`` bytes apart, or packed."""
    if not header.points:
        return [np.empty(0, dtype=np.float32)] * 3
    columns: list[NDArray[Any]] = []
    for k, start in zip(axes, starts, strict=True):
        kind = header.fields[k].type
        stride = kind.itemsize if step is None else step
        columns.append(np.ndarray((header.points,), kind, data, start, (stride,)))
    return columns


def expect_points(header: PcdHeader, found: int, what: str) -> None:
    """Raise ContentError unless as many ``what`` are found as the header has points."""
    if found != header.points:
        raise ContentError(f"{found} {what} for {header.points} points in its header")


_BODIES: dict[str, Callable[[PcdHeader, list[int], Buffer], list[NDArray[Any]]]] = {
    "ascii": _ascii,
    "binary": _binary,
    "binary_compressed": _compressed,
}

"""Files of point clouds of any size, read in chunks: .pcd, .ply, .las and .laz."""

import mmap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans import pcd, ply
from deepring.data.scans.content import ContentError
from deepring.data.scans.coordinates import expect_type
from deepring.data.scans.names import ending_of
from deepring.data.scans.pcd_header import read_header as read_pcd_header
from deepring.data.scans.ply_header import read_header as read_ply_header
from deepring.data.scans.text_rows import text_rows
from deepring.errors import DataError, FileError
from deepring.io.files import reason_of
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer_file

#: Points read at a time.
CHUNK = 1 << 20
#: Lines of text read at a time.
_LINES = 1 << 17


class Chunk(NamedTuple):
    """Some of the points of a cloud."""

    points: NDArray[np.float64]
    """(n, 3) in the cloud's own coordinates, as they are in the file: NaN may be among them."""
    single: bool
    """Whether the file has them in single precision."""


Chunks = Iterator[Chunk]


@dataclass(frozen=True)
class CloudFile:
    """One file of a cloud, whose header has been read."""

    path: Path
    points: int
    """As its header says."""
    read: Callable[[], Chunks]

    def chunks(self) -> Chunks:
        """The points, some at a time, in the file's order.

        Raises DataError for a file that is damaged or cut short, after the points before that.
        """
        try:
            yield from self.read()
        except (ContentError, OSError) as error:
            raise _damaged(self.path, error) from None


def open_cloud_file(path: Path | str) -> CloudFile:
    """The file of a cloud, by the ending of its name.

    Raises FileError for a file that is missing or has another ending, DataError for one that is
    none of its format, and ConfigError where the reader of .las and .laz is not installed.
    """
    path = Path(path)
    ending = ending_of(path)
    if ending not in OPENERS:
        raise FileError(f"cloud {path}: ending {path.suffix!r}, expected {', '.join(OPENERS)}")
    if not path.is_file():
        raise FileError(f"cloud {path}: no such file; expected a point cloud")
    if is_lfs_pointer_file(path):
        raise DataError(f"cloud {path}: {LFS_POINTER}")
    if path.stat().st_size == 0:
        raise DataError(f"cloud {path}: 0 bytes, an empty file; expected a point cloud")
    try:
        return OPENERS[ending](path)
    except (ContentError, OSError) as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> DataError:
    reason = f"cannot be read ({reason_of(error)})" if isinstance(error, OSError) else str(error)
    kind = ending_of(path).removeprefix(".").upper()
    return DataError(f"cloud {path}: {reason}; expected a complete {kind} file")


def _open_pcd(path: Path) -> CloudFile:
    header = read_pcd_header(_mapped(path))
    axes = pcd.coordinate_axes(header)
    if header.data != "ascii":
        return CloudFile(path, header.points, lambda: _mapped_chunks(path, pcd.columns_of))
    starts = [sum(field.count for field in header.fields[:k]) for k in axes]
    width = sum(field.count for field in header.fields)
    kinds = [header.fields[k].type for k in axes]

    def chunks() -> Chunks:
        found = 0
        with path.open("rb") as file:
            file.seek(header.end)
            for lines in _batches(file):
                rows = text_rows(b"".join(lines), width)
                found += len(rows)
                yield _chunk(
                    [expect_type(rows[:, s], kind) for s, kind in zip(starts, kinds, strict=True)],
                    kinds,
                )
        pcd.expect_points(header, found, "lines")

    return CloudFile(path, header.points, chunks)


def _open_ply(path: Path) -> CloudFile:
    form, elements, start = read_ply_header(_mapped(path))
    axes = ply.vertex_axes(elements)
    vertices = next(element for element in elements if element.name == "vertex")
    if form != "ascii":
        return CloudFile(path, vertices.rows, lambda: _mapped_chunks(path, ply.columns_of))
    kinds = [np.dtype(vertices.properties[k].value) for k in axes]

    def chunks() -> Chunks:
        with path.open("rb") as file:
            file.seek(start)
            lines = (line for line in file if line.strip())
            for element in elements:
                if not element.properties:
                    continue
                found = 0
                while found < element.rows:
                    batch = list(islice(lines, min(_LINES, element.rows - found)))
                    if not batch:
                        raise ply.too_short(element, found)
                    found += len(batch)
                    wanted = axes if element is vertices else []
                    columns = ply.text_columns(element, wanted, batch)
                    if columns:
                        yield _chunk(columns, kinds)
            more = sum(1 for _ in lines)
            if more:
                raise ply.too_long(elements, f"{more} lines")

    return CloudFile(path, vertices.rows, chunks)


def _open_las(path: Path) -> CloudFile:
    from deepring.data.clouds.las import las_chunks, las_points

    return CloudFile(path, las_points(path), lambda: (Chunk(p, False) for p in las_chunks(path)))


OPENERS: dict[str, Callable[[Path], CloudFile]] = {
    ".pcd": _open_pcd,
    ".ply": _open_ply,
    ".las": _open_las,
    ".laz": _open_las,
}


def _mapped(path: Path) -> mmap.mmap:
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _mapped_chunks(path: Path, columns_of: Callable[[mmap.mmap], list[NDArray[Any]]]) -> Chunks:
    content = _mapped(path)
    columns = columns_of(content)
    kinds = [column.dtype for column in columns]
    for start in range(0, len(columns[0]), CHUNK):
        yield _chunk([column[start : start + CHUNK] for column in columns], kinds)
        # Pages of the file that have been read would count as memory of this process.
        if hasattr(mmap, "MADV_DONTNEED"):
            content.madvise(mmap.MADV_DONTNEED)


def _batches(lines: Iterator[bytes]) -> Iterator[list[bytes]]:
    while batch := list(islice(lines, _LINES)):
        yield batch


def _chunk(columns: list[NDArray[Any]], kinds: list[np.dtype]) -> Chunk:
    with np.errstate(invalid="ignore"):  # signalling NaN
        points = np.stack([column.astype(np.float64) for column in columns], axis=1)
    single = all(kind.kind == "f" and kind.itemsize == 4 for kind in kinds[:2])
    return Chunk(points, single)

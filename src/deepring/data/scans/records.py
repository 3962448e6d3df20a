"""Scan files that consist of point records."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.content import content_of
from deepring.errors import BrokenScanError
from deepring.io.git_lfs import LFS_POINTER, LONGEST_POINTER, is_lfs_pointer_file

#: One point of a MulRan or KITTI scan: x, y, z in metres and an intensity, little-endian float32.
XYZI = np.dtype([("xyz", "<f4", (3,)), ("intensity", "<f4")])


def size_problem(size: int, *records: np.dtype) -> str | None:
    """The reason why a file of ``size`` bytes cannot consist of such records, or None."""
    sizes = " or ".join(str(record.itemsize) for record in records)
    if size == 0:
        return f"0 bytes, an empty file; expected records of {sizes} bytes each"
    if all(size % record.itemsize for record in records):
        return f"{size} bytes; expected a multiple of {sizes}, the size of one point record"
    return None


def file_problem(path: Path, *records: np.dtype) -> str | None:
    """The reason why a file cannot be read or has an impossible size (`size_problem`), or None.

    A Git LFS pointer is recognised whatever its size.
    """
    try:
        size = path.stat().st_size
    except OSError as error:  # e.g. a broken link
        return f"cannot be read ({error.strerror})"
    if size < LONGEST_POINTER and is_lfs_pointer_file(path):
        return LFS_POINTER
    return size_problem(size, *records)


def read_records(path: Path | str, record: np.dtype) -> NDArray:
    """The (n,) records of one file.

    Raises BrokenScanError if the file has an impossible size, and as `content_of`.
    """
    return records_from(content_of(path), record, path)


def records_from(data: bytes, record: np.dtype, source: Path | str) -> NDArray:
    """View ``data`` as (n,) records. Raises BrokenScanError naming ``source`` and its size."""
    problem = size_problem(len(data), record)
    if problem:
        raise BrokenScanError(f"{source}: {problem}. Fetch or unpack the file again")
    return np.frombuffer(data, dtype=record)

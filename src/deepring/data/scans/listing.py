"""Lists the scans of a folder by the numbers in their names, without opening files."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.records import file_problem
from deepring.errors import DataError

_LARGEST_STAMP = np.iinfo(np.int64).max


class Listing(NamedTuple):
    """The scans of one folder in ascending order of the number in their names."""

    files: tuple[Path, ...]
    numbers: NDArray[np.int64]  # (n,): the number in each name times the unit
    broken: tuple[str, ...]  # skipped files, each with its reason


def list_scans(folder: Path, *records: np.dtype, unit: int = 1) -> Listing:
    """List ``folder/<number>.bin``, with one stat per file.

    ``unit`` scales the numbers (1000 converts microseconds to nanoseconds). A file that is empty,
    not a whole number of ``records`` of any of the types long, or whose name is not a number goes
    to ``broken``. Raises DataError if no file is left.
    """
    scans: list[tuple[int, Path]] = []
    broken: list[str] = []
    for path in sorted(folder.iterdir(), key=lambda path: path.name):
        # Some systems unpack hidden "._<name>.bin" files, which are not scans.
        if not path.name.endswith(".bin") or path.name.startswith("."):
            continue
        stem = path.name.removesuffix(".bin")
        number = int(stem) * unit if stem.isascii() and stem.isdigit() else -1
        if not 0 <= number <= _LARGEST_STAMP:
            broken.append(f"{path}: the name is not a scan number or time stamp")
        elif problem := file_problem(path, *records):
            broken.append(f"{path}: {problem}")
        else:
            scans.append((number, path))
    if not scans:
        raise _nothing_readable(folder, broken)
    scans.sort()
    numbers = np.array([number for number, _ in scans], dtype=np.int64)
    return Listing(tuple(path for _, path in scans), numbers, tuple(broken))


def _nothing_readable(folder: Path, broken: list[str]) -> DataError:
    if not broken:
        return DataError(
            f"no scans: {folder} contains no .bin file; expected <number>.bin. Check that the "
            "archive was unpacked here"
        )
    return DataError(
        f"all {len(broken)} scans of {folder} are broken (first: {broken[0]}). "
        "Fetch or unpack them again"
    )

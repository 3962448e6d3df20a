"""Lists the scans of a folder by the numbers in their names, without opening files."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deepring.data.scans.names import files_with
from deepring.data.scans.records import file_problem
from deepring.errors import DataError

_DIGITS = re.compile(r"[0-9]{1,30}")
_LARGEST_STAMP = np.iinfo(np.int64).max


class Listing(NamedTuple):
    """The scans of one folder in ascending order of the number in their names."""

    files: tuple[Path, ...]
    numbers: NDArray[np.int64]  # (n,): the number in each name times the unit
    broken: tuple[str, ...]  # skipped files, each with its reason


def list_scans(folder: Path, *records: np.dtype, unit: int = 1) -> Listing:
    """List ``folder/<number>.bin``, with one stat per file.

    ``unit`` scales the numbers (1000 converts microseconds to nanoseconds). A file that is empty,
    not a whole number of ``records`` of any of the types long, whose name is not a number, or that
    of another file, goes to ``broken``. Raises DataError if no file is left.
    """
    broken: list[str] = []
    taken: dict[int, Path] = {}
    for path in files_with(folder, (".bin",)):
        number = int(path.stem) * unit if _DIGITS.fullmatch(path.stem) else -1
        if not 0 <= number <= _LARGEST_STAMP:
            broken.append(f"{path}: the name is not a scan number or time stamp")
        elif number in taken:
            broken.append(f"{path}: the number is that of {taken[number].name}, too")
        elif problem := file_problem(path, *records):
            broken.append(f"{path}: {problem}")
        else:
            taken[number] = path
    if not taken:
        raise _nothing_readable(folder, broken)
    numbers = np.array(sorted(taken), dtype=np.int64)
    return Listing(tuple(taken[number] for number in numbers.tolist()), numbers, tuple(broken))


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

"""Point clouds in NumPy's .npy files: arrays of numbers with x, y and z first.

The header is parsed here, as the library evaluates it and takes what is behind the array.
"""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from deepring.data.scans.content import ContentError, decoded
from deepring.data.scans.coordinates import points_of
from deepring.data.session import Points

_MAGIC = b"\x93NUMPY"
_ENTRY = re.compile(
    r"""\s*(['"])(?P<key>descr|fortran_order|shape)\1\s*:\s*(?P<value>
    (['"])[^'"]*\4 | True | False | \([0-9L,\s]*\) )\s*(?:,|(?=\}))""",
    re.VERBOSE,
)
_NUMBERS = re.compile(r"([<>|=]?)(f[248]|[iu][1248])")
#: Most numbers of a point, so that pictures and descriptors are not taken for points.
_MOST_COLUMNS = 32
_MOST_COLUMNS_OF_A_GRID = 8


class _Header(NamedTuple):
    type: np.dtype
    shape: tuple[int, ...]
    fortran: bool
    end: int  # byte at which the array begins


def read_npy(path: Path | str) -> Points:
    """The points (n, 3) float32 of an array (n, 3) or wider, x, y and z first.

    An array (rows, columns, 3 to 8) is one organised scan, which is read row by row. Numbers may
    have any real type and byte order. Raises BrokenScanError for another array, or another type of
    file, and for one with fewer or more bytes than its header says.
    """
    return decoded(path, _points, ".npy")


def _points(content: bytes) -> Points:
    kind, shape, fortran, end = _header(content)
    size = math.prod(shape) * kind.itemsize
    if len(content) - end != size:
        raise ContentError(
            f"{len(content) - end} bytes after its header, not {size} for shape {shape} of "
            f"{kind.name}"
        )
    if problem := _shape_problem(shape):
        raise ContentError(f"an array of shape {shape}: {problem}")
    array = np.frombuffer(content, kind, math.prod(shape), end)
    array = array.reshape(shape, order="F" if fortran else "C")[..., :3]
    return points_of([array[..., k].ravel() for k in range(3)])


def _shape_problem(shape: tuple[int, ...]) -> str | None:
    """The reason why an array is not points, or None."""
    wanted = "expected (n, 3) or wider, a point in each row, x, y and z first"
    if len(shape) not in (2, 3) or shape[-1] < 3:
        return wanted
    if len(shape) == 2 and 3 <= shape[0] < shape[1]:
        return f"more columns than rows; {wanted}: transpose it, if a column is a point"
    if shape[-1] > (_MOST_COLUMNS if len(shape) == 2 else _MOST_COLUMNS_OF_A_GRID):
        return f"{shape[-1]} numbers for each point; {wanted}"
    return None


def _header(content: bytes) -> _Header:
    if not content.startswith(_MAGIC):
        raise ContentError("does not begin as a .npy file")
    major = content[6] if len(content) > 7 else 0
    if major not in (1, 2, 3) or content[7]:
        raise ContentError("another version of the format than 1.0, 2.0 or 3.0")
    start = 10 if major == 1 else 12
    end = start + int.from_bytes(content[8:start], "little")
    if len(content) < end:
        raise ContentError("ends within its header")
    entries = _entries(content[start:end].decode("latin-1"))
    numbers = _NUMBERS.fullmatch(entries["descr"][1:-1])
    if numbers is None:
        raise ContentError(f"an array of type {entries['descr'][1:-1][:40]!r}, not of real numbers")
    shape = tuple(int(number.rstrip("L")) for number in _dimensions(entries["shape"]))
    kind = np.dtype(entries["descr"][1:-1])
    return _Header(kind, shape, entries["fortran_order"] == "True", end)


def _entries(text: str) -> dict[str, str]:
    """The texts of descr, fortran_order and shape in a header, which is a dictionary of Python."""
    text = text.strip()
    entries: dict[str, str] = {}
    at = 1 if text.startswith("{") else len(text)
    while match := _ENTRY.match(text, at):
        if match["key"] in entries:
            raise ContentError(f"a header with {match['key']} twice")
        entries[match["key"]] = match["value"]
        at = match.end()
    whole = text[at:].strip() == "}" and len(entries) == 3
    if whole and entries["shape"][0] == "(" and entries["fortran_order"] in ("True", "False"):
        return entries
    if re.search(r"descr['\"]\s*:\s*[\[(]", text):
        raise ContentError("an array of records, not of numbers (n, 3)")
    raise ContentError(f"the header {text[:80]!r}")


def _dimensions(text: str) -> list[str]:
    """The numbers of a tuple."""
    numbers = [part.strip() for part in text[1:-1].split(",")]
    if numbers and not numbers[-1]:
        numbers.pop()
    if any(not re.fullmatch(r"\d{1,18}L?", number) for number in numbers):
        raise ContentError(f"shape {text[:80]!r} in its header")
    return numbers

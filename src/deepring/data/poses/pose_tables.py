"""Text tables of poses: rows of numbers, exact stamps, 3x4 matrices and TUM's quaternions."""

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deepring.data.poses.rigid import unit_rows
from deepring.data.poses.stamps import nanoseconds_of
from deepring.errors import FileError
from deepring.io.text import open_text, read_text, text_problem

#: Separators by name; None are blanks.
_SEPARATORS = {"commas": ",", "semicolons": ";", "blanks": None}
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?")


def stamped_rows(columns: int) -> np.dtype:
    """Row type of a pose table: an integer ``stamp``, exact to the nanosecond, and ``values``."""
    # Read as float64, a stamp in nanoseconds since 1970 would be off by up to 128 ns.
    return np.dtype([("stamp", np.int64), ("values", np.float64, (columns,))])


def read_table(
    path: Path, row: np.dtype, delimiter: str | None, description: str, *, seconds: bool = False
) -> NDArray:
    """Read a text table without header into (n,) rows of type ``row``.

    With ``seconds``, the first column holds decimal seconds and becomes whole nanoseconds.
    ``description`` describes a row in messages. Raises FileError for a file that cannot be read,
    for an invalid row, with its line, and for a file without rows.
    """
    converters: Any = {0: nanoseconds_of} if seconds else None
    try:
        with warnings.catch_warnings(), open_text(path) as file:
            warnings.simplefilter("error")  # NumPy only warns of an empty file
            return np.loadtxt(
                file, dtype=row, delimiter=delimiter, ndmin=1, converters=converters, encoding=None
            )
    except (OSError, ValueError, OverflowError, Warning) as error:
        raise FileError(
            f"{path}: {_problem(path, row, delimiter, seconds)}; expected no header, and in each "
            f"row {description}. Fetch the file again, or repair the row"
        ) from error


def _problem(path: Path, row: np.dtype, delimiter: str | None, seconds: bool) -> str:
    """The reason why a file is not a table of such rows, e.g. its first invalid row."""
    problem = text_problem(path)
    if problem is not None:
        return problem
    parsers = _parsers(row, seconds)
    rows = 0
    for number, line in enumerate(read_text(path, "text").splitlines(), start=1):
        text = line.partition("#")[0].strip()
        if not text and line.partition("#")[0] and delimiter is not None:
            return f"line {number} holds blanks alone"
        if text:
            rows += 1
            problem = _row_problem(text, parsers, delimiter, first=rows == 1)
            if problem is not None:
                return f"line {number} reads {text[:80]!r}, {problem}"
    return "contains an invalid row" if rows else "contains no row"


def _parsers(row: np.dtype, seconds: bool) -> list[Callable[[str], float]]:
    """What reads each of the numbers of a row, and raises ValueError with the reason."""
    parsers: list[Callable[[str], float]] = []
    for name in row.names or ():
        column = row[name]
        kind = _whole if column.base.kind in "iu" else _real
        parsers += [kind] * int(np.prod(column.shape, initial=1))
    if seconds:
        parsers[0] = nanoseconds_of
    return parsers


def _whole(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        raise ValueError(f"{text[:40]!r} is no whole number") from None
    if abs(value) >= 2**63:
        raise ValueError(f"{text[:40]} is out of range")
    return value


def _real(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        if _DECIMAL_COMMA.fullmatch(text):
            raise ValueError(f"{text[:40]!r} has a decimal comma: write a point") from None
        raise ValueError(f"{text[:40]!r} is no number") from None


def _row_problem(
    text: str, parsers: list[Callable[[str], float]], delimiter: str | None, *, first: bool
) -> str | None:
    """Why a row cannot be read, or None."""
    values = text.split(delimiter)
    if first and not any(_is_number(value) for value in re.split(r"[\s,;]+", text)):
        return "a header"
    if len(values) != len(parsers):
        for name, separator in _SEPARATORS.items():
            if separator != delimiter and len(text.split(separator)) == len(parsers):
                expected = next(k for k, value in _SEPARATORS.items() if value == delimiter)
                return f"separated by {name} instead of {expected}"
        return f"{len(values)} values instead of {len(parsers)}"
    for value, parse in zip(values, parsers, strict=True):
        try:
            parse(value)
        except ValueError as error:
            return str(error)
    return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def poses_from_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from rows (n, 12): the upper 3x4 of each, row by row."""
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    poses[:, 3, 3] = 1.0
    return poses


def poses_from_quaternions(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from TUM rows (n, 7): x, y, z and a quaternion qx, qy, qz, qw.

    A quaternion that is not of length 1 to within rounding, see `unit_rows`, gives a rotation
    scaled by its length, which `rigid_rows` does not accept.
    """
    from scipy.spatial.transform import Rotation

    quaternions = rows[:, 3:]
    unit = unit_rows(quaternions)
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.where(unit, 1.0, np.linalg.norm(quaternions, axis=1))
    turned = np.isfinite(lengths) & (lengths > 0)
    poses = np.zeros((len(rows), 4, 4))
    if turned.any():
        rotations = Rotation.from_quat(quaternions[turned]).as_matrix()
        poses[turned, :3, :3] = rotations * lengths[turned, None, None]
    poses[~np.isfinite(lengths), :3, :3] = np.nan
    poses[:, :3, 3] = rows[:, :3]
    poses[:, 3, 3] = 1.0
    return poses

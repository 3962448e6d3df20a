"""Text tables of poses: rows of numbers, exact stamps, 3x4 matrices and TUM's quaternions."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deepring.errors import FileError
from deepring.io.git_lfs import LFS_POINTER, is_lfs_pointer_file

NANOSECONDS = 1_000_000_000  # in a second


def stamped_rows(columns: int) -> np.dtype:
    """Row type of a pose table: an integer ``stamp``, exact to the nanosecond, and ``values``."""
    # Read as float64, a stamp in nanoseconds since 1970 would be off by up to 128 ns.
    return np.dtype([("stamp", np.int64), ("values", np.float64, (columns,))])


def read_table(path: Path, row: np.dtype, delimiter: str | None, description: str) -> NDArray:
    """Read a text table without header into (n,) rows of type ``row``.

    ``description`` describes a row in messages. Raises FileError for a file that cannot be read,
    for an invalid row, with its line, and for a file without rows.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy only warns of an empty file
            return np.loadtxt(path, dtype=row, delimiter=delimiter, ndmin=1)
    except (OSError, ValueError, OverflowError, Warning) as error:
        raise FileError(
            f"{path}: {_problem(path, row, delimiter)}; expected no header, and in each row "
            f"{description}. Fetch the file again, or repair the row"
        ) from error


def _problem(path: Path, row: np.dtype, delimiter: str | None) -> str:
    """The reason why a file is not a table of such rows, e.g. its first invalid row."""
    if is_lfs_pointer_file(path):
        return LFS_POINTER
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    except UnicodeDecodeError:
        return "is not text"
    kinds = _kinds(row)
    rows = 0
    for number, line in enumerate(lines, start=1):
        text = line.partition("#")[0].strip()
        if text:
            rows += 1
            if not _fits(text.split(delimiter), kinds):
                return f"line {number} reads {text[:80]!r}"
    return "contains an invalid row" if rows else "contains no row"


def _kinds(row: np.dtype) -> list[type]:
    """The types, int or float, of the numbers of a row."""
    kinds: list[type] = []
    for name in row.names or ():
        column = row[name]
        kinds += [int if column.base.kind in "iu" else float] * int(
            np.prod(column.shape, initial=1)
        )
    return kinds


def _fits(values: list[str], kinds: list[type]) -> bool:
    try:
        numbers = [kind(value) for kind, value in zip(kinds, values, strict=True)]
    except ValueError:
        return False
    return all(abs(number) < 2**63 for number in numbers if isinstance(number, int))


def poses_from_rows(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from rows (n, 12): the upper 3x4 of each, row by row."""
    poses = np.zeros((len(rows), 4, 4))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    poses[:, 3, 3] = 1.0
    return poses


def poses_from_quaternions(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) from TUM rows (n, 7): x, y, z and a quaternion qx, qy, qz, qw.

    Rows become NaN if the length of the quaternion differs from 1 by more than 1 %.
    """
    from scipy.spatial.transform import Rotation

    poses = np.full((len(rows), 4, 4), np.nan)
    unit = np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1) < 0.01  # False for NaN
    if unit.any():
        poses[unit, :3, :3] = Rotation.from_quat(rows[unit, 3:]).as_matrix()
        poses[unit, :3, 3] = rows[unit, :3]
        poses[unit, 3] = [0, 0, 0, 1]
    return poses


def rigid_rows(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 4, 4) that are finite and rigid to within 1 %."""
    finite = np.isfinite(poses).all(axis=(1, 2))
    # Clipping prevents overflow in the product; entries of rotations are at most 1.
    rotations = np.clip(np.nan_to_num(poses[:, :3, :3]), -2.0, 2.0)
    product = np.einsum("nij,nkj->nik", rotations, rotations)
    orthonormal = np.abs(product - np.eye(3)).max(axis=(1, 2), initial=0.0) < 0.01
    # A reflection is orthonormal too: the third row must be the cross product of the others.
    third = np.cross(rotations[:, 0], rotations[:, 1])
    proper = np.einsum("ni,ni->n", third, rotations[:, 2]) > 0
    return np.asarray(finite & orthonormal & proper, dtype=np.bool_)
